"""GenICam cameras on GigE Vision, through Aravis.

Debian and Ubuntu: gir1.2-aravis-0.8, and PyGObject (python3-gi, or `cldit[aravis]`). The camera is
opened at its address, so nothing is broadcast and it may be in another subnet.
"""

import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cldit.io.extras import install_line
from cldit.rig.checks import check_answer
from cldit.rig.drivers import DriverAbout, RigContext, check_settings
from cldit.rig.errors import ConfigRejected, NotConnected, RigError

from .genicam_camera import GenicamCamera
from .genicam_client import GigeSettings, Image

T = TypeVar("T")

_GVCP = 3956  # UDP port of the control protocol (GigE Vision 2.0)
_SPARE = 4  # buffers beyond the requested images
_ROOM, _LEAST_ROOM = 4, 2**20  # of the socket: images, bytes; limited by net.core.rmem_max
_PIXELS = {8: "u1", 16: "<u2"}  # by the bits of a pixel in its format's code
_LINK_ERRORS = ("NOT_CONNECTED", "NOT_FOUND", "TIMEOUT", "TRANSFER_ERROR", "NOT_CONTROLLER")

ABOUT = DriverAbout(
    "camera",
    "GenICam cameras on GigE Vision, through Aravis",
    "untested on hardware; tested with Aravis' own simulated camera and one of ours",
    needs=("gi", "gi.repository.Aravis"),
    install="apt install python3-gi gir1.2-aravis-0.8; in a virtual environment that does not see "
    f"the system's packages also {install_line('aravis')}",
)


class AravisClient:
    """Implements `genicam_client.Client`."""

    def __init__(self, settings: GigeSettings) -> None:
        """Takes control of the camera; raises NotConnected."""
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis, Gio, GLib

        self._aravis, self._error = Aravis, GLib.Error
        self._settings = settings
        self._stream: Any = None
        self._lost = False
        self._link_errors = {int(getattr(Aravis.DeviceError, name)) for name in _LINK_ERRORS}
        local, remote = (
            Gio.InetAddress.new_from_string(ip_address)
            for ip_address in (settings.interface or _way_to(settings.address), settings.address)
        )
        if local is None or remote is None:
            raise NotConnected("address, interface: allowed: IP addresses")
        try:
            self._device = Aravis.GvDevice.new(local, remote)
        except GLib.Error as error:
            raise NotConnected(f"no such camera on the network ({error.message})") from error
        try:
            self._under_control()
            # A packet socket, which only root gets, would take 60 ms for each start.
            self._device.set_stream_options(Aravis.GvStreamOption.PACKET_SOCKET_DISABLED)
            if settings.packet_size is not None:
                self._ask(lambda d: d.set_packet_size(settings.packet_size))
                self._device.set_packet_size_adjustment(Aravis.GvPacketSizeAdjustment.NEVER)
        except RigError:
            self.close()
            raise

    def _ask(self, action: Callable[[Any], T]) -> T:
        """Result of `action(device)`, with errors of the rig."""
        try:
            return action(self._device)
        except self._error as error:
            link = error.domain == "arv-device-error-quark" and error.code in self._link_errors
            if link:
                self._lost = True
                raise NotConnected(
                    f"camera: the link failed ({error.message}); check the cable"
                ) from error
            raise ConfigRejected(f"camera: {error.message}") from error

    def _under_control(self) -> None:
        if not self._device.is_controller():
            raise NotConnected("camera: another program has control of it, or it was unplugged")

    def has(self, name: str) -> bool:
        return bool(self._ask(lambda d: d.is_feature_implemented(name)))

    def get_integer(self, name: str) -> int:
        return int(self._ask(lambda d: d.get_integer_feature_value(name)))

    def set_integer(self, name: str, value: int) -> None:
        self._ask(lambda d: d.set_integer_feature_value(name, value))

    def get_float(self, name: str) -> float:
        return check_answer("camera", name, self._ask(lambda d: d.get_float_feature_value(name)))

    def set_float(self, name: str, value: float) -> None:
        self._ask(lambda d: d.set_float_feature_value(name, value))

    def float_limits(self, name: str) -> tuple[float, float]:
        limits = self._ask(lambda d: d.get_float_feature_bounds(name))
        return limits.min, limits.max

    def get_string(self, name: str) -> str:
        return str(self._ask(lambda d: d.get_string_feature_value(name)))

    def get_enum(self, name: str) -> str:
        return self.get_string(name)

    def set_enum(self, name: str, entry: str) -> None:
        self._ask(lambda d: d.set_string_feature_value(name, entry))

    def get_text(self, name: str) -> str | None:
        if not self._ask(lambda d: d.is_feature_available(name)):
            return None
        return str(self._ask(lambda d: d.get_feature(name).get_value_as_string()))

    def set_text(self, name: str, value: str) -> None:
        self._ask(lambda d: d.get_feature(name).set_value_from_string(value))

    def entries(self, name: str) -> tuple[str, ...]:
        return tuple(
            self._ask(lambda d: d.dup_available_enumeration_feature_values_as_strings(name))
        )

    def execute(self, command: str) -> None:
        self._ask(lambda d: d.execute_command(command))

    def read_register(self, address: int) -> int:
        return int(self._ask(lambda d: d.read_register(address)))

    def write_register(self, address: int, value: int) -> None:
        self._ask(lambda d: d.write_register(address, value))

    def start(self) -> None:
        self.execute("AcquisitionStart")

    def stop(self) -> None:
        self.execute("AcquisitionStop")

    def open_stream(self, frames: int) -> None:
        bits = (self.get_integer("PixelFormat") >> 16) & 0xFF
        if bits not in _PIXELS:
            raise ConfigRejected(
                f"camera: pixel_format: {self.get_enum('PixelFormat')} has {bits} bits a pixel; "
                "allowed: formats of 8 and 16"
            )
        self._stream = None  # releases the port of the old one
        # The device's own create_stream cannot be called without a callback.
        self._stream = self._ask(
            lambda d: self._aravis.Camera.new_with_device(d).create_stream(None, None)
        )
        size = self.get_integer("PayloadSize")
        # Aravis reserves room for one image, of which the kernel uses half, and only at the first
        # packet, too late for the next ones.
        room = max(_ROOM * size, _LEAST_ROOM)
        self._stream.set_property("socket-buffer", self._aravis.GvStreamSocketBuffer.FIXED)
        self._stream.set_property("socket-buffer-size", room)
        _make_room(self._stream.get_port(), room)
        # Any part of an image may be requested again, not the usual quarter alone.
        self._stream.set_property("packet-request-ratio", 1.0)
        for _ in range(frames + _SPARE):
            self._stream.push_buffer(self._aravis.Buffer.new_allocate(size))

    def next_image(self, timeout_s: float) -> Image | None:
        got = self._stream.timeout_pop_buffer(max(1, round(1e6 * timeout_s)))
        if got is None:
            self._under_control()
            return None
        pixels = None
        complete = got.get_status() == self._aravis.BufferStatus.SUCCESS
        if complete:  # Aravis returns no data of others
            kind = _PIXELS[(got.get_image_pixel_format() >> 16) & 0xFF]
            shape = got.get_image_height(), got.get_image_width()
            flat = np.frombuffer(got.get_image_data(), kind, shape[0] * shape[1])
            pixels = flat.astype(np.uint16).reshape(shape)
        image = Image(pixels, got.get_frame_id(), got.get_timestamp(), complete)
        self._stream.push_buffer(got)
        return image

    def close(self) -> None:
        self._stream = None
        if not self._lost:  # a lost link would take the time of all retries
            try:
                self._device.leave_control()
            except self._error:  # already gone
                pass
        self._device = None


def _way_to(address: str) -> str:
    """The computer's own address towards the camera; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, _GVCP))
        except OSError as error:
            raise NotConnected(f"no route to {address} ({error})") from error
        return str(probe.getsockname()[0])


def _make_room(port: int, size: int) -> None:
    """Enlarges the buffer of this process's socket at a port, which Aravis does not expose."""
    folder = Path("/proc/self/fd")
    for entry in list(folder.iterdir()) if folder.is_dir() else ():
        try:
            if not entry.is_socket():
                continue
            with socket.socket(fileno=os.dup(int(entry.name))) as stream_socket:
                inet = (
                    stream_socket.family == socket.AF_INET
                    and stream_socket.type == socket.SOCK_DGRAM
                )
                if inet and stream_socket.getsockname()[1] == port:
                    stream_socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        except OSError:  # closed meanwhile
            continue


def open_aravis_camera(settings: dict[str, Any], context: RigContext) -> GenicamCamera:
    """The driver `aravis_camera`."""
    return GenicamCamera(AravisClient, check_settings(GigeSettings, settings))
