"""The camera's driver before GigE Vision cameras that are not ours: viva-genicam's fake one, and
Aravis' (Debian: aravis-tools). They know neither our XML nor our mistakes: other names, other
triggers, features that are not there, frame ids that do not begin at one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from cldit.rig.clock import Clock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import ConfigRejected, MissingFrames, OutOfLimits
from cldit.rig.protocols import Frame, Roi, TriggerInfo, TriggerMode

pytest.importorskip("viva_genicam", reason="viva_genicam is missing; install cldit[rig]")
from viva_genicam.testing import FakeGigeCamera  # (after the check that it is there)

from tests.aravis import aravis_peer
from tests.emulators.rig import CALIBRATION
from tests.patience import HANG_s, until

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.gige_camera import GenicamCamera

pytestmark = pytest.mark.gige


def driver(address: str, **settings: Any) -> GenicamCamera:
    made: GenicamCamera = load_driver("gige_camera")(
        {"address": address, "interface": "127.0.0.1", "calibration": CALIBRATION, **settings},
        RigContext(Clock(), None, Path(), 1),
    )
    made.connect(5.0)
    return made


@pytest.fixture(params=["viva's camera", "Aravis' camera"])
def camera(request: pytest.FixtureRequest) -> Iterator[GenicamCamera]:
    with ExitStack() as stack:
        if request.param == "viva's camera":
            fake = stack.enter_context(FakeGigeCamera(64, 48, pixel_format="Mono16"))
            made = driver(fake.ip)
        else:
            made = driver(stack.enter_context(aravis_peer()), line="Line0")
        yield made
        made.close()


def shoot(camera: GenicamCamera, n: int = 1) -> list[Frame]:
    """As the runner takes pictures: armed for each shot."""
    frames: list[Frame] = []
    for _ in range(n):
        camera.prepare(TriggerInfo(TriggerMode.SOFTWARE))
        camera.flush()
        camera.arm()
        camera.software_trigger()
        frames += camera.read_frames(1, 5.0)
        camera.disarm()
    return frames


def test_pictures(camera: GenicamCamera) -> None:
    """Settings are read back, pictures whole, ids and times in order."""
    camera.wait_ready(1.0)
    settings = camera.configure(5e-3, Roi(8, 16, 64, 32))
    assert settings.integration_time_s == pytest.approx(5e-3, rel=0.01)
    assert settings.roi == Roi(8, 16, 64, 32) and settings.pixel_format == "Mono16"
    frames = shoot(camera, 4)
    assert all(frame.complete and frame.data.shape == (32, 64) for frame in frames)
    assert all(frame.data.dtype == np.uint16 and np.ptp(frame.data) > 0 for frame in frames)
    assert np.all(np.diff([frame.frame_id for frame in frames]) == 1)
    assert np.all(np.diff([frame.host_timestamp_ns for frame in frames]) > 0)
    camera.prepare(TriggerInfo(TriggerMode.INTERNAL, n_frames=4))
    camera.arm()
    free = list(camera.read_frames(4, 2.0))
    camera.disarm()
    assert np.all(np.diff([frame.frame_id for frame in free]) == 1)
    assert free[0].frame_id > frames[-1].frame_id
    stored = camera.read_configuration()
    assert stored["roi"] == [8, 16, 64, 32] and stored["calibration"]["saturation_counts"] == 16383


def test_what_it_cannot_do(camera: GenicamCamera) -> None:
    low, high = camera.capabilities.integration_time_limits_s
    for outside in (0.5 * low, 2.0 * high, float("nan")):
        with pytest.raises(OutOfLimits):
            camera.configure(outside)
    with pytest.raises(ConfigRejected, match="frames: 1"):
        camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE, 4, frames_per_trigger=4))
    camera.prepare(TriggerInfo(TriggerMode.EXTERNAL_EDGE))
    camera.arm()
    with pytest.raises(MissingFrames):  # nobody pulses the line
        list(camera.read_frames(1, 0.2))
    camera.make_safe()
    camera.make_safe()


@pytest.mark.parametrize("resend", [True, False])
def test_lost_packets(resend: bool) -> None:
    """A packet that viva's fake loses is asked for again; a camera that cannot resend leaves a
    picture that says of itself that it is incomplete, between others that are whole."""
    with FakeGigeCamera(
        64, 48, fps=50, pixel_format="Mono16", drop_packets=[(2, 1)], packet_resend=resend
    ) as fake:
        camera = driver(fake.ip, packet_size=1000)
        camera.configure(1e-3, Roi(0, 0, 64, 48))
        camera.prepare(TriggerInfo(TriggerMode.INTERNAL, n_frames=5))
        camera.arm()
        frames = list(camera.read_frames(5, 2.0))
        camera.close()
    assert [frame.complete for frame in frames] == [True, resend, True, True, True]
    # Its ramp is 257 counts higher in each picture, but where it wraps: in 4 x 257 of 65536 pixels.
    # The lost packet is a seventh of the picture.
    right = [
        frame.data.size > 0
        and np.mean(frame.data == frames[0].data + np.uint16(257 * number)) > 0.97
        for number, frame in enumerate(frames)
    ]
    assert right == [True, resend, True, True, True]


def test_control_is_given_back() -> None:
    with FakeGigeCamera(64, 48, pixel_format="Mono16") as fake:
        camera = driver(fake.ip)
        assert fake.controller() is not None
        camera.close()
        until(lambda: fake.controller() is None)
        camera.connect(HANG_s)
        camera.configure(1e-3, Roi(0, 0, 64, 48))  # its sensor has 33 MB a picture
        assert len(shoot(camera)) == 1
        camera.close()


def test_a_picture_without_its_end_is_incomplete() -> None:
    """What the client cannot make a picture of is a frame that fails, not an error of its own."""
    import viva_genicam

    class Cut:
        block_id, ts_dev, is_complete, missing_packets = 1, 0, False, 7

        def to_numpy(self) -> None:
            raise viva_genicam.ParseError("payload is 100 bytes; the image needs 6144")

    class Stream:
        def next_frame(self, timeout_ms: int) -> Cut:
            return Cut()

        def close(self) -> None: ...

    with FakeGigeCamera(64, 48, pixel_format="Mono16") as fake:
        camera = driver(fake.ip)
        assert camera._client is not None
        camera._client._stream = Stream()
        camera._streams = True
        (frame,) = camera.read_frames(1, 1.0)
        camera.close()
    assert not frame.complete and camera.statistics()["incomplete"] == 1
