"""Emulator of a whole rig on loopback sockets: camera, black body, delay generator, and wires.

python -m tests.emulators.rig rig.yaml     # writes a rig file for it, and runs until Ctrl-C
"""

from __future__ import annotations

import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.io.files import write_text
from cldit.io.plain_data import dump_yaml
from cldit.io.terminal import tell
from tests.emulators.blackbody import FlukePeer, ModbusPeer
from tests.emulators.dg645 import Dg645Peer
from tests.emulators.gige_camera import GigePeer
from tests.emulators.lines import Edge

_IN_AIR_s = 0.05  # time for which fuel is visible after an injection
_ANSWER_s = 60.0  # limit: an answer takes milliseconds, on an idle machine
_FAST_s = 0.05  # time constant of the black body

# A camera of 14 bit that can measure black bodies from 340 K.
CALIBRATION = {
    "integration_time_s": 25e-6,
    "filter_um": [3.3, 3.5],
    "counts_per_radiance": 1e-18,
    "offset_counts": 1000.0,
    "electrons_per_count": 430.0,
    "read_noise_electrons": 200.0,
    "saturation_counts": 16383,
}


def blackbody_choice(peer: FlukePeer | ModbusPeer, **settings: Any) -> dict[str, Any]:
    """Part of a rig file for an emulated Fluke or Eurotherm, with other settings."""
    line = {"host": peer.host, "port": peer.port, **settings}
    if isinstance(peer, FlukePeer):
        return {"driver": "fluke418x", "settings": line}
    own = {"model": "eurotherm-3200", "temperature_unit": "celsius", "limits_K": [283.0, 873.0]}
    return {"driver": "modbus_blackbody", "settings": {**own, **line}}


class PeerRig:
    """Emulated rig, running once entered. The generator's output AB is the camera's Line1, CD the
    injector, which injects while `fuel_pressure`. The black body is a Eurotherm, or `fluke`."""

    def __init__(
        self,
        *,
        camera: GigePeer | None = None,
        fluke: bool = False,
        time_constant_s: float = _FAST_s,
        start_K: float = 295.0,
    ) -> None:
        self.camera = camera or GigePeer()
        self.blackbody: FlukePeer | ModbusPeer = (
            FlukePeer(time_constant_s=time_constant_s, start_K=start_K)
            if fluke
            else ModbusPeer("eurotherm-3200", time_constant_s=time_constant_s, start_K=start_K)
        )
        self.generator = Dg645Peer(on_edge=self._wire)
        self.fuel_pressure = True
        self._injected_s = -1.0
        self._fuel: dict[int, bool] = {0: False}  # from the image of this number on
        self._plain, self.camera.scene = self.camera.scene, self._image
        self._stack = ExitStack()

    def _wire(self, edge: Edge) -> None:
        if edge.output == "CD":
            self._injected_s = edge.time_s
        elif edge.output == "AB":
            since_s = edge.time_s - self._injected_s
            self._fuel[self.camera.taken + 1] = self.fuel_pressure and 0.0 <= since_s < _IN_AIR_s
            self.camera.line(edge.time_s)

    def _image(self, number: int, exposure_s: float) -> NDArray[np.uint16]:
        """The camera's image, with half the counts where fuel is."""
        image = self._plain(number, exposure_s)
        if self._fuel[max(first for first in self._fuel if first <= number)]:
            rows, columns = image.shape
            image[rows // 4 : -rows // 4, columns // 4 : -columns // 4] //= 2
        return image

    @property
    def injections(self) -> int:
        """Number of pulses at the injector."""
        return len(self.generator.pulses("CD"))

    def __enter__(self) -> PeerRig:
        for peer in (self.camera, self.blackbody, self.generator):
            self._stack.enter_context(peer)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def rig_data(self) -> dict[str, Any]:
        """Content of its rig file."""
        return {
            "name": "peers on loopback",
            "setup": {"pixel_m": [1e-4, 1e-4]},
            "camera": {
                "driver": "gige_camera",
                "settings": {
                    "address": self.camera.host,
                    "interface": "127.0.0.1",
                    "calibration": CALIBRATION,
                },
            },
            "background": blackbody_choice(self.blackbody, answer_s=_ANSWER_s),
            "trigger": {
                "driver": "dg645",
                "settings": {
                    "host": self.generator.host,
                    "port": self.generator.port,
                    "answer_s": _ANSWER_s,
                },
            },
        }


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with PeerRig() as rig:
        write_text(Path(sys.argv[1]), dump_yaml(rig.rig_data()))
        tell(f"{sys.argv[1]} is written; Ctrl-C ends the rig")
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return


if __name__ == "__main__":
    main()
