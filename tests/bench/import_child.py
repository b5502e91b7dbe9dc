"""Measured process, which loads only the modules that its work needs."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def _write(folder: str, writer: str, cells_a_side: str, parcels: str) -> None:
    from tests.bench import import_cases as cases

    getattr(cases, writer)(Path(folder), cells_a_side=int(cells_a_side), parcels=int(parcels))


def _vtk(_: str, *files: str) -> list[Any]:
    """Reads all of the case at once, as ParaView does."""
    from vtkmodules.vtkIOGeometry import vtkOpenFOAMReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader

    readers: dict[str, Any] = {
        ".vtu": vtkXMLUnstructuredGridReader,
        ".vtp": vtkXMLPolyDataReader,
        ".foam": vtkOpenFOAMReader,
    }
    found = []
    for file in files:
        reader = readers[Path(file).suffix]()
        reader.SetFileName(file)
        reader.Update()
        found.append(reader.GetOutput())
    return found


def _cldit(folder: str, out: str = "") -> None:
    from cldit.cfd.importing import cfd_spray, imported

    spec = cfd_spray({"file": folder, "nozzle_m": (0.0, 0.0, 0.0), "axis": "-y"})
    imported(spec, Path(out) if out else None)


if __name__ == "__main__":
    work: dict[str, Callable[..., Any]] = {"write": _write, "vtk": _vtk, "cldit": _cldit}
    kept = work[sys.argv[1]](*sys.argv[2:])
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    peak = next(line.split()[1] for line in lines if line.startswith("VmHWM"))
    print(json.dumps({"resident_bytes": int(peak) * 1024, "cpu_s": time.process_time()}))
