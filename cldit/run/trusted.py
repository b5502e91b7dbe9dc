"""Devices that are trusted: those that have passed their check, and PoCL, on which cldit is tested.

A device is checked once with its driver and the kernels of this version, before its first use. A
device that has failed is not chosen, and is refused by its name.
"""

from __future__ import annotations

import logging

from cldit.errors import DeviceError
from cldit.gpu import device as devices
from cldit.gpu.checks import failed_devices, store_check, stored_check, tested
from cldit.gpu.device import Device

_LOG = logging.getLogger("cldit")


def open_device(wanted: str | None = None) -> Device:
    """Opens a device, or several that share the work, after a check before the first use.

    A process opens each device once and keeps it until `Device.close`, so that many runs, also in
    threads, share its programs.

    Args:
        wanted: `platform:device`, or part of a device's or platform's name; several with commas,
            of which the first does all work that is not shared. None chooses, among the devices
            that have not failed their check, the GPU with the most memory, or else the device with
            the most compute units.

    Returns:
        The device, open.

    Raises:
        DeviceError: there is no such device, it cannot be opened, it fails its check, or this
            process is a fork of one that had used OpenCL.
    """
    device = devices.open_device(wanted, failed_devices())
    for opened in (device, *device.others):
        check = stored_check(opened.info)
        if check is None and not tested(opened.info):
            from cldit.run.device_check import check_device  # and with it all models of sprays

            _LOG.warning(
                "%s: is checked before its first use, for a minute or two", opened.info.name
            )
            check = check_device(opened)
            store_check(opened.info, check)
        if check is not None and check.faults:
            device.close()
            if wanted is None and stored_check(opened.info) is not None:
                return open_device()  # another device, or the error that none is left
            raise DeviceError(
                f"device {opened.info.index} ({opened.info.name}): its results are wrong: "
                f"{check.faults[0]}; install another version of its driver, which is then checked "
                "(`cldit devices --check` lists all faults), or another device (`cldit devices`)"
            )
    return device
