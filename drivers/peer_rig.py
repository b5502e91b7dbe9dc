"""A whole rig on loopback sockets: camera, black body and delay generator, wired to each other.

python -m cldit.drivers.peer_rig rig.yaml     # writes a rig file for it, and runs until Ctrl-C
"""

from __future__ import annotations

import sys
import threading
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml

from .heater import Dynamics
from .peer_blackbody import ModbusPeer
from .peer_dg645 import Dg645Peer, Edge
from .peer_gige import GigePeer

_FAST = Dynamics(time_constant_s=0.05)

# A camera of 14 bit that sees black bodies from 340 K.
CALIBRATION = {
    "integration_time_s": 25e-6,
    "filter_um": [3.3, 3.5],
    "counts_per_radiance": 1e-18,
    "offset_counts": 1000.0,
    "electrons_per_count": 430.0,
    "read_noise_electrons": 200.0,
    "saturation_counts": 16383,
}


class PeerRig:
    """Enter it to switch everything on. The generator's output AB is the camera's Line1."""

    def __init__(
        self, *, camera: GigePeer | None = None, dynamics: Dynamics = _FAST, start_K: float = 295.0
    ) -> None:
        self.camera = camera or GigePeer()
        self.blackbody = ModbusPeer("eurotherm-3200", dynamics=dynamics, start_K=start_K)
        self.generator = Dg645Peer(on_edge=self._wire)
        self._stack = ExitStack()

    def _wire(self, edge: Edge) -> None:
        if edge.output == "AB":
            self.camera.line(edge.time_s)

    @property
    def injections(self) -> int:
        """Pulses at the injector since it was switched on."""
        return len(self.generator.pulses("CD"))

    def __enter__(self) -> PeerRig:
        for peer in (self.camera, self.blackbody, self.generator):
            self._stack.enter_context(peer)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.close()

    def rig_data(self) -> dict[str, Any]:
        """The rig file for it."""
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
            "background": {
                "driver": "modbus_blackbody",
                "settings": {
                    "model": "eurotherm-3200",
                    "host": self.blackbody.host,
                    "port": self.blackbody.port,
                    "limits_K": [283.0, 873.0],
                },
            },
            "trigger": {
                "driver": "dg645",
                "settings": {"host": self.generator.host, "port": self.generator.port},
            },
        }


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with PeerRig() as rig:
        Path(sys.argv[1]).write_text(yaml.safe_dump(rig.rig_data(), sort_keys=False))
        print(f"{sys.argv[1]} is written; Ctrl-C ends the rig", flush=True)
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return


if __name__ == "__main__":
    main()
