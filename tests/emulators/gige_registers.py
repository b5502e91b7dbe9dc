"""Registers and XML description of the GigE Vision camera that `gige_camera` plays.

Bootstrap registers: GigE Vision 1.2, section 28. Feature names: GenICam SFNC 2.
"""

from __future__ import annotations

import struct
from xml.sax.saxutils import escape

MONO16, MONO8 = 0x01100007, 0x01080001
FORMATS = {"Mono16": MONO16, "Mono8": MONO8}

# Bootstrap
CAPABILITY, HEARTBEAT, TICKS_HIGH = 0x934, 0x938, 0x93C
TIMESTAMP_CONTROL, TIMESTAMP, CONTROL = 0x944, 0x948, 0xA00
STREAM_PORT, PACKET_SIZE, STREAM_HOST, STREAM_SOURCE = 0xD00, 0xD04, 0xD18, 0xD1C

# The camera's own
WIDTH, HEIGHT, OFFSET_X, OFFSET_Y, PIXEL_FORMAT, PAYLOAD = (0xA000 + 4 * i for i in range(6))
EXPOSURE, FRAME_RATE = 0xA020, 0xA024  # float32: microseconds, hertz
TRIGGER_MODE, TRIGGER_SOURCE, TRIGGER_ACTIVATION, TRIGGER_SOFTWARE = (
    0xA030 + 4 * i for i in range(4)
)
ACQUISITION_MODE, FRAME_COUNT, START, STOP, LOCKED = (0xA050 + 4 * i for i in range(5))
MISSED_TRIGGERS, TRIGGER_SELECTOR, BURST_COUNT = (0xA070 + 4 * i for i in range(3))
GAIN_AUTO, BINNING, IR_FORMAT, NUC_MODE, GAIN = (0xA080 + 4 * i for i in range(5))  # float32: dB
XML_AT = 0x10000
SIZE = 0x20000

FRAME, BURST = 0, 1  # trigger selectors
SOURCES = {"Software": 0, "Line1": 1}
MODES = {"SingleFrame": 0, "MultiFrame": 1, "Continuous": 2}
IR_FORMATS = {"Radiometric": 0, "TemperatureLinear100mK": 1, "TemperatureLinear10mK": 2}
EXPOSURE_LIMITS_us = (0.32, 1e6)


def own(address: int) -> bool:
    """True for the camera's own registers, which its description names."""
    return WIDTH <= address < XML_AT


def bootstrap(
    memory: bytearray, host: str, sensor: tuple[int, int], serial: str, schema: tuple[int, int]
) -> None:
    """Fills the memory of a camera after its start; its description has this schema of GenApi."""

    def put(address: int, value: int) -> None:
        struct.pack_into(">I", memory, address, value)

    def text(address: int, size: int, value: str) -> None:
        memory[address : address + size] = value.encode().ljust(size, b"\0")

    address = struct.unpack(">I", bytes(int(part) for part in host.split(".")))[0]
    put(0x0, 0x0001_0002)
    put(0x4, 0x8000_0001)
    put(0x8, 0x0000_02C1)
    put(0xC, address)
    put(0x10, 0x8000_0007)
    put(0x14, 0x0000_0004)
    put(0x24, address)
    put(0x34, 0xFF00_0000)
    for at, size, value in (
        (0x48, 32, "cldit"),
        (0x68, 32, "GigE Vision peer"),
        (0x88, 32, "1"),
        (0xD8, 16, serial),
    ):
        text(at, size, value)
    put(0x600, 1)
    put(0x904, 1)
    put(CAPABILITY, 0b111)  # resend, WRITEMEM, several registers at once
    put(HEARTBEAT, 3000)
    put(TICKS_HIGH + 4, 1_000_000_000)
    put(PACKET_SIZE, 8192)
    columns, rows = sensor
    put(WIDTH, columns)
    put(HEIGHT, rows)
    put(PIXEL_FORMAT, MONO16)
    put(ACQUISITION_MODE, MODES["Continuous"])
    put(FRAME_COUNT, 1)
    put(BURST_COUNT, 1)
    put(BINNING, 1)
    struct.pack_into(">f", memory, EXPOSURE, 1000.0)
    description = xml(sensor, schema).encode()
    memory[XML_AT : XML_AT + len(description)] = description
    text(0x200, 512, f"Local:peer.xml;{XML_AT:x};{len(description):x}")


def xml(sensor: tuple[int, int], schema: tuple[int, int] = (1, 1)) -> str:
    """The GenApi description; what it does not name, a client cannot reach."""
    columns, rows = sensor
    old = schema < (1, 1)  # and SFNC 1, whose names these are
    features: list[str] = []
    names: list[str] = []

    def register(kind: str, name: str, address: int, length: int, *more: str, mode: str) -> None:
        features.append(
            f'<{kind} Name="{name}Reg"><Address>0x{address:X}</Address><Length>{length}</Length>'
            f"<AccessMode>{mode}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
            f"{''.join(more)}</{kind}>"
        )

    unsigned = ("<Sign>Unsigned</Sign>", "<Endianess>BigEndian</Endianess>")

    def add(kind: str, name: str, body: str) -> None:
        features.append(f'<{kind} Name="{name}"><Visibility>Beginner</Visibility>{body}</{kind}>')
        names.append(name)

    def integer(name: str, at: int, low: int, high: int, step: int = 1, mode: str = "RW") -> None:
        register("IntReg", name, at, 4, *unsigned, mode=mode)
        add(
            "Integer",
            name,
            f"<pValue>{name}Reg</pValue><Min>{low}</Min><Max>{high}</Max><Inc>{step}</Inc>",
        )

    def real(name: str, at: int, low: float, high: float, unit: str, mode: str = "RW") -> None:
        register("FloatReg", name, at, 4, unsigned[1], mode=mode)
        add(
            "Float",
            name,
            f"<pValue>{name}Reg</pValue><Min>{low:g}</Min><Max>{high:g}</Max><Unit>{unit}</Unit>",
        )

    def choice(name: str, at: int, entries: dict[str, int]) -> None:
        register("IntReg", name, at, 4, *unsigned, mode="RW")
        listed = "".join(
            f'<EnumEntry Name="{entry}"><Value>{value}</Value></EnumEntry>'
            for entry, value in entries.items()
        )
        add("Enumeration", name, f"{listed}<pValue>{name}Reg</pValue>")

    def command(name: str, at: int) -> None:
        register("IntReg", name, at, 4, *unsigned, mode="WO")
        add("Command", name, f"<pValue>{name}Reg</pValue><CommandValue>1</CommandValue>")

    def text(name: str, at: int, length: int) -> None:
        features.append(
            f'<StringReg Name="{name}"><Address>0x{at:X}</Address><Length>{length}</Length>'
            "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>"
        )
        names.append(name)

    text("DeviceVendorName", 0x48, 32)
    text("DeviceModelName", 0x68, 32)
    text("DeviceVersion", 0x88, 32)
    text("DeviceSerialNumber", 0xD8, 16)
    whole = ("WidthMax", "HeightMax") if old else ("SensorWidth", "SensorHeight")
    integer(whole[0], WIDTH + 0x100, columns, columns, mode="RO")
    integer(whole[1], HEIGHT + 0x100, rows, rows, mode="RO")
    integer("Width", WIDTH, 1, columns)
    integer("Height", HEIGHT, 1, rows)
    integer("OffsetX", OFFSET_X, 0, columns - 1)
    integer("OffsetY", OFFSET_Y, 0, rows - 1)
    choice("PixelFormat", PIXEL_FORMAT, FORMATS)
    integer("PayloadSize", PAYLOAD, 0, 2**31 - 1, mode="RO")
    absolute = "Abs" if old else ""
    real(f"ExposureTime{absolute}", EXPOSURE, *EXPOSURE_LIMITS_us, "us")
    real(f"AcquisitionFrameRate{absolute}", FRAME_RATE, 1e-3, 1e5, "Hz", mode="RO")
    burst = "AcquisitionStart" if old else "FrameBurstStart"
    choice("TriggerSelector", TRIGGER_SELECTOR, {"FrameStart": FRAME, burst: BURST})
    choice("TriggerMode", TRIGGER_MODE, {"Off": 0, "On": 1})
    choice("TriggerSource", TRIGGER_SOURCE, SOURCES)
    choice("TriggerActivation", TRIGGER_ACTIVATION, {"RisingEdge": 0, "FallingEdge": 1})
    command("TriggerSoftware", TRIGGER_SOFTWARE)
    choice("AcquisitionMode", ACQUISITION_MODE, MODES)
    integer("AcquisitionFrameCount", FRAME_COUNT, 1, 2**31 - 1)
    if not old:
        integer("AcquisitionBurstFrameCount", BURST_COUNT, 1, 2**31 - 1)
    if not old:
        real("Gain", GAIN, 0.0, 24.0, "dB")
        choice("GainAuto", GAIN_AUTO, {"Off": 0, "Continuous": 2})
        choice("BinningHorizontal", BINNING, {"One": 1, "Two": 2})
        choice("IRFormat", IR_FORMAT, IR_FORMATS)
        choice("NUCMode", NUC_MODE, {"Manual": 0, "Automatic": 1})
    command("AcquisitionStart", START)
    command("AcquisitionStop", STOP)
    integer("TLParamsLocked", LOCKED, 0, 1)
    integer("MissedTriggerCount", MISSED_TRIGGERS, 0, 2**31 - 1, mode="RO")
    integer("GevHeartbeatTimeout", HEARTBEAT, 500, 60_000)
    integer("GevSCPSPacketSize", PACKET_SIZE, 576, 9000)
    listed = "".join(f"<pFeature>{escape(name)}</pFeature>" for name in names)
    return (
        '<?xml version="1.0" encoding="utf-8"?>'
        '<RegisterDescription ModelName="Peer" VendorName="cldit" ToolTip="GigE Vision peer" '
        f'StandardNameSpace="GEV" SchemaMajorVersion="{schema[0]}" '
        f'SchemaMinorVersion="{schema[1]}" '
        'SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0" '
        'ProductGuid="6b1d2a54-27f6-44c1-9f2a-0d9d0f4c1e11" '
        'VersionGuid="6b1d2a54-27f6-44c1-9f2a-0d9d0f4c1e12" '
        f'xmlns="http://www.genicam.org/GenApi/Version_{schema[0]}_{schema[1]}">'
        f'<Category Name="Root">{listed}</Category>{"".join(features)}'
        '<Port Name="Device"/></RegisterDescription>'
    )
