"""Emulator of a GigE Vision camera on loopback, with a trigger line, for tests of the drivers.

GVCP (control) and GVSP (images) by the GigE Vision 1.2 specification: discovery, registers, control
privilege with heartbeat, packet resend. Several can run at once, each at its own loopback address;
a search for cameras finds the newest.
"""

from __future__ import annotations

import queue
import random
import secrets
import select
import socket
import struct
import threading
import time
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from cldit.testing.replies import BINARY_NAN, Replies
from tests.emulators import gige_registers as reg
from tests.emulators.gige_stream import Image, image_packets, pattern
from tests.patience import HANG_s

_GVCP = 3956
_DENIED, _BAD_ADDRESS, _UNSUPPORTED = 0x8006, 0x8003, 0x8001
_TICK_s = 0.05  # of its own clock
_KEPT = 8  # images that can be sent again


class GigePeer:
    """Emulated camera, which runs once entered; `host` is its address.

    legacy: a camera with GenICam 1.0: its own registers are numbers for READREG and WRITEREG, but
    READMEM and WRITEMEM access the little-endian memory of its processor (GenICam standard 2.0,
    appendix 3); names of SFNC 1.

    loss: fraction of the stream's packets that never arrive, drawn with `seed`. skip: number of the
    next images that are never sent; `skipped` counts them. cut: number of the next images that lack
    their second half, and are not sent again. scene: gives an image by its number and the
    integration time in seconds. stuck: addresses of registers that keep their value. taken: images
    since the start. missed: triggers while not ready. replies: channel of its answers on the
    control channel.
    """

    def __init__(
        self,
        sensor: tuple[int, int] = (640, 512),
        *,
        image: Image | None = None,
        frame_rate_Hz: float = 146.7,
        loss: float = 0.0,
        seed: int = 1,
        host: str | None = None,
        legacy: bool = False,
    ) -> None:
        self.sensor = sensor
        self._legacy = legacy
        self.host = host or ".".join(["127", *(str(secrets.randbelow(254) + 1) for _ in "abc")])
        self.serial = f"{secrets.randbelow(10**8):08d}"
        self.loss, self.skip, self.cut, self.skipped = loss, 0, 0, 0
        self.taken = self.missed = self.lost_packets = 0
        self.replies = Replies(BINARY_NAN)
        self.scene = image or pattern(sensor)
        self.stuck: set[int] = set()
        self._rate_Hz = frame_rate_Hz
        self._random = random.Random(seed)
        self._lock = threading.RLock()
        self._memory = bytearray(reg.SIZE)
        self._controller: tuple[str, int] | None = None
        self._deaf_to: tuple[str, int] | None = None
        self._silent_s = 0.0  # while it listened: a machine that stalls keeps its client
        self._active = False
        self._left = 0
        self._block = 0
        self._last_s = -1.0
        self._sent: OrderedDict[int, list[bytes]] = OrderedDict()
        self._triggers: queue.SimpleQueue[float | None] = queue.SimpleQueue()

    def __enter__(self) -> GigePeer:
        self._memory[:] = bytes(reg.SIZE)
        schema = (1, 0) if self._legacy else (1, 1)
        reg.bootstrap(self._memory, self.host, self.sensor, self.serial, schema)
        self._put_float(reg.FRAME_RATE, self._rate_Hz)
        self._modes = dict.fromkeys((reg.FRAME, reg.BURST), 0)
        for at, size in zip((reg.WIDTH, reg.HEIGHT), self.sensor, strict=True):
            self._put(at + 0x100, size)
        self._stream = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4 << 20)
        self._stream.bind((self.host, 0))
        self._put(reg.STREAM_SOURCE, self._stream.getsockname()[1])
        # Clients search on loopback at 127.0.0.1, where the newest of several peers is found. No
        # other address is bound, so nothing from a network arrives.
        self._hearing = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in "ab"]
        for ear, address in zip(self._hearing, (self.host, "127.0.0.1"), strict=True):
            ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            ear.bind((address, _GVCP))
        self._control = self._hearing[0]
        self._on = True
        self._threads = [
            threading.Thread(target=target, daemon=True) for target in (self._listen, self._expose)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.switch_off()

    def switch_off(self) -> None:
        """Stops it, as if its cable were unplugged."""
        if not self._on:
            return
        self._on = False
        self._triggers.put(None)
        for thread in self._threads:
            thread.join(HANG_s)
        for item in (*self._hearing, self._stream):
            item.close()

    def unheard(self) -> None:
        """Ignores its present client from now on, as if that had died."""
        with self._lock:
            self._deaf_to = self._controller

    @property
    def armed(self) -> bool:
        """True if an edge on the line would start an exposure."""
        with self._lock:
            self._expire()
            return self._active and self._left > 0

    @property
    def controlled(self) -> bool:
        """True if a client has control."""
        with self._lock:
            self._expire()
            return self._controller is not None

    def line(self, at_s: float | None = None) -> None:
        """Sends a rising edge to Line1, now or at a given time of time.monotonic()."""
        with self._lock:
            self._expire()
            if self._triggered and self._get(reg.TRIGGER_SOURCE) == reg.SOURCES["Line1"]:
                self._trigger(at_s)
            else:
                self._miss()

    def image(self, number: int) -> NDArray[np.uint16]:
        """The image of a number (from 1) as sent with the present settings."""
        whole = self.scene(number, 1e-6 * self._get_float(reg.EXPOSURE))
        x, y, w, h = (self._get(at) for at in (reg.OFFSET_X, reg.OFFSET_Y, reg.WIDTH, reg.HEIGHT))
        return whole[y : y + h, x : x + w]

    # Triggers and images

    @property
    def _triggered(self) -> bool:
        return any(self._modes.values())

    def _miss(self) -> None:
        self.missed += 1
        self._put(reg.MISSED_TRIGGERS, self.missed)

    def _trigger(self, at_s: float | None = None) -> None:
        now_s = time.monotonic() if at_s is None else at_s
        soon = now_s - self._last_s < 0.98 / self._rate_Hz
        if not self._active or self._left <= 0 or soon:
            self._miss()
            return
        counted = reg.FRAME_COUNT if self._legacy else reg.BURST_COUNT
        count = self._get(counted) if self._modes[reg.BURST] == 1 else 1
        for number in range(min(count, self._left)):
            self._last_s = now_s + number / self._rate_Hz
            self._left -= 1
            self._triggers.put(self._last_s)

    def _expose(self) -> None:
        while (taken_s := self._triggers.get()) is not None:
            exposure_s = 1e-6 * self._get_float(reg.EXPOSURE)
            time.sleep(max(taken_s + exposure_s - time.monotonic(), 0.0))
            with self._lock:
                self.taken += 1
                self._block = self._block % 65535 + 1
                packets = self._packets(self._block, taken_s)
                self._sent[self._block] = packets
                while len(self._sent) > _KEPT:
                    self._sent.popitem(last=False)
                target = self._target()
                if self.cut > 0:
                    self.cut -= 1
                    del packets[len(packets) // 2 : -1]
                if self.skip > 0:
                    self.skip -= 1
                    self.skipped += 1
                    del self._sent[self._block]
                    continue
            if target is not None:
                for packet in packets:
                    self._send(packet, target)
            if not self._triggered:
                with self._lock:
                    self._free_run()

    def _free_run(self) -> None:
        if self._active and self._left > 0:
            self._left -= 1
            next_s = max(self._last_s + 1.0 / self._rate_Hz, time.monotonic())
            time.sleep(max(next_s - time.monotonic(), 0.0))
            self._last_s = next_s
            self._triggers.put(next_s)

    def _packets(self, block: int, taken_s: float) -> list[bytes]:
        return image_packets(
            self.image(self.taken),
            block=block,
            taken_s=taken_s,
            pixel=self._get(reg.PIXEL_FORMAT),
            corner=(self._get(reg.OFFSET_X), self._get(reg.OFFSET_Y)),
            packet_size=self._get(reg.PACKET_SIZE) & 0xFFFF,
        )

    def _send(self, packet: bytes, target: tuple[str, int]) -> None:
        if self.loss and self._random.random() < self.loss:
            self.lost_packets += 1
            return
        self._stream.sendto(packet, target)

    def _target(self) -> tuple[str, int] | None:
        port = self._get(reg.STREAM_PORT) & 0xFFFF
        host = socket.inet_ntoa(self._memory[reg.STREAM_HOST : reg.STREAM_HOST + 4])
        return (host, port) if port else None

    # Control

    def _listen(self) -> None:
        while self._on:
            begin_s = time.monotonic()
            hears = select.select(self._hearing, [], [], _TICK_s)[0]
            with self._lock:
                self._silent_s += min(time.monotonic() - begin_s, 2.0 * _TICK_s)
            for ready in hears:
                data, sender = ready.recvfrom(2048)
                if len(data) >= 8 and data[0] == 0x42:
                    self._command(data, sender)

    def _command(self, data: bytes, sender: tuple[str, int]) -> None:
        flags, command, length, number = struct.unpack(">BHHH", data[1:8])
        body = data[8 : 8 + length]
        if command == 0x0040:
            self._resend(body)
            return
        with self._lock:
            self._expire()
            if sender == self._deaf_to:
                return
            if sender == self._controller:
                self._silent_s = 0.0
            status, answer = self._answer(command, body, sender)
        if command == 0x0002 or flags & 1:
            reply = struct.pack(">HHHH", status, command + 1, len(answer), number) + answer
            reply = self.replies.passed(reply, slice(8, None))
            if reply:
                self._control.sendto(reply, sender)

    def _answer(self, command: int, body: bytes, sender: tuple[str, int]) -> tuple[int, bytes]:
        if command == 0x0002:  # discovery
            return 0, bytes(self._memory[:0xF8])
        if command == 0x0080:  # registers
            addresses = [int(at) for (at,) in struct.iter_unpack(">I", body)]
            if any(at > reg.SIZE - 4 or at % 4 for at in addresses):
                return _BAD_ADDRESS, b""
            return 0, b"".join(self._read(at) for at in addresses)
        if command == 0x0084:  # memory
            at, _, count = struct.unpack(">IHH", body)
            if at + count > reg.SIZE:
                return _BAD_ADDRESS, b""
            words = range(at - at % 4, at + count, 4)
            data = b"".join(self._in_memory(word, self._read(word)) for word in words)
            return 0, body[:4] + data[at % 4 : at % 4 + count]
        if command == 0x0082:
            for index, (at, value) in enumerate(struct.iter_unpack(">II", body)):
                status = self._write(at, value, sender)
                if status:
                    return status, struct.pack(">HH", 0, index)
            return 0, struct.pack(">HH", 0, len(body) // 8)
        if command == 0x0086:
            (at,) = struct.unpack(">I", body[:4])
            for index in range(4, len(body) - 3, 4):
                word = at + index - 4
                value = int.from_bytes(self._in_memory(word, body[index : index + 4]), "big")
                status = self._write(word, value, sender)
                if status:
                    return status, b""
            return 0, struct.pack(">HH", 0, len(body) - 4)
        return _UNSUPPORTED, b""

    def _in_memory(self, at: int, word: bytes) -> bytes:
        """A register's four bytes as READMEM and WRITEMEM have them."""
        return word[::-1] if self._legacy and reg.own(at) else word

    def _read(self, at: int) -> bytes:
        if at == reg.PAYLOAD:
            wide = 2 if self._get(reg.PIXEL_FORMAT) == reg.MONO16 else 1
            self._put(at, self._get(reg.WIDTH) * self._get(reg.HEIGHT) * wide)
        return bytes(self._memory[at : at + 4])

    def _write(self, at: int, value: int, sender: tuple[str, int]) -> int:
        if at > reg.SIZE - 4 or at % 4:
            return _BAD_ADDRESS
        if at == reg.CONTROL and self._controller in (None, sender):
            self._controller = sender if value & 3 else None
            self._silent_s = 0.0
            if self._controller is None:
                self._release()
            self._put(at, value)
            return 0
        if sender != self._controller:
            return _DENIED
        if at in self.stuck:
            return 0
        if at == reg.TRIGGER_SOFTWARE:
            if self._triggered and self._get(reg.TRIGGER_SOURCE) == 0:
                self._trigger()
        elif at == reg.START:
            self._start()
        elif at == reg.STOP:
            self._active = False
        elif at == reg.TRIGGER_SELECTOR and value in self._modes:
            self._put(at, value)
            self._put(reg.TRIGGER_MODE, self._modes[value])
        elif at == reg.TRIGGER_MODE:
            self._modes[self._get(reg.TRIGGER_SELECTOR)] = value
            self._put(at, value)
        elif at == reg.TIMESTAMP_CONTROL:
            if value & 2:
                stamp = round(1e9 * time.monotonic())
                struct.pack_into(">Q", self._memory, reg.TIMESTAMP, stamp)
        elif at == reg.PACKET_SIZE and value & 0x8000_0000:
            self._put(at, value & 0x7FFF_FFFF)
            target = self._target()
            if target is not None:
                self._stream.sendto(bytes((value & 0xFFFF) - 28), target)
        else:
            self._put(at, value)
        return 0

    def _start(self) -> None:
        self._active = True
        self._block = 0
        self._sent.clear()
        limits = {0: 1, 1: self._get(reg.FRAME_COUNT)}
        self._left = limits.get(self._get(reg.ACQUISITION_MODE), 2**31)
        if not self._triggered:
            self._free_run()

    def _resend(self, body: bytes) -> None:
        _, block, first, last = struct.unpack(">HHII", body[:12])
        with self._lock:
            packets = self._sent.get(block, [])
            target = self._target()
        if target is not None:
            for packet in packets[first & 0xFFFFFF : (last & 0xFFFFFF) + 1]:
                self._send(packet, target)

    def _expire(self) -> None:
        """Control is given up when its holder is not heard for the heartbeat's time."""
        silent_ms = 1e3 * self._silent_s
        if self._controller is not None and silent_ms > self._get(reg.HEARTBEAT):
            self._controller = None
            self._put(reg.CONTROL, 0)
            self._release()

    def _release(self) -> None:
        self._active = False
        self._put(reg.STREAM_PORT, 0)
        self._put(reg.LOCKED, 0)

    def _get(self, at: int) -> int:
        return int(struct.unpack_from(">I", self._memory, at)[0])

    def _put(self, at: int, value: int) -> None:
        struct.pack_into(">I", self._memory, at, value)

    def _get_float(self, at: int) -> float:
        return float(struct.unpack_from(">f", self._memory, at)[0])

    def _put_float(self, at: int, value: float) -> None:
        struct.pack_into(">f", self._memory, at, value)
