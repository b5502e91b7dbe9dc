"""Geometry of the scene for all kernels that traverse the octree: camera, boundary, octree."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats, Ints, Mask, Reals
from cldit.errors import TransportError
from cldit.gpu.buffers import download, unset, upload
from cldit.gpu.device import Device
from cldit.gpu.program import GROUP, Program, build
from cldit.medium.frame import CELLS_PER_BRICK
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.scene.schema import Scene
from cldit.transport.boundary import patch_rows
from cldit.transport.cells import OpticalCells
from cldit.transport.linear_coefficients import device_cells
from cldit.transport.sobol import net, on_disc


def dilated(chosen: Mask, pixels: int) -> Mask:
    """Mask (H, W) of pixels in the squares of 2 `pixels` + 1 about `chosen` ones."""
    return np.asarray(scipy.ndimage.maximum_filter(chosen, 2 * pixels + 1, mode="constant"))


@dataclass(frozen=True)
class View:
    """Camera and background in finest cells from the cube's lower corner.

    disc: (4,) centre x, y, z and squared radius; infinite for an enclosure.
    patches: (P, 4, 4), see boundary.py.
    middle: (4,) the target point, and 1 for a pinhole camera, 0 for parallel rays.
    pitch: width and height of a pixel in the target plane.
    distance: from the camera to the target.
    pixels: columns, rows.
    device: finds what pixels see.
    regular: several rays of a pixel are on a regular grid; else they are a net, which has no two of
    them in a row or column (edges of cells are parallel to those). aperture: radius of the lens; 0:
    a pinhole. focus: from the camera to the plane in focus. visible: emissivity above which a pixel
    has a T_app.
    """

    disc: Floats
    patches: Floats
    middle: Floats
    pitch: tuple[float, float]
    distance: float
    pixels: tuple[int, int]
    device: Device
    regular: bool = True
    aperture: float = 0.0
    focus: float = np.inf
    visible: float = VISIBLE_EMISSIVITY

    @classmethod
    def of(
        cls,
        scene: Scene,
        cells: OpticalCells,
        device: Device,
        *,
        visible: float = VISIBLE_EMISSIVITY,
    ) -> "View":
        """The view of `scene`, in finest cells of the octree of `cells`."""
        frame, camera = cells.tree.frame, scene.camera
        centre = frame.to_cells(np.asarray([scene.background_centre_m]))[0]
        (columns, rows), (width_m, height_m) = camera.pixels, camera.field_m
        is_disc = scene.background.shape == "disc"
        radius = scene.background.radius_m / frame.cell_m if is_disc else np.inf
        return cls(
            disc=np.array([*centre, radius**2]),
            patches=patch_rows(scene.patches, frame),
            middle=np.array(
                [*frame.to_cells(np.asarray([scene.target_m]))[0], camera.model == "pinhole"]
            ),
            pitch=(width_m / frame.cell_m / columns, height_m / frame.cell_m / rows),
            distance=camera.distance_m / frame.cell_m,
            pixels=camera.pixels,
            device=device,
            regular=camera.rays_across is not None and camera.lens is None,
            aperture=camera.aperture_m / frame.cell_m / 2,
            focus=camera.focus_m / frame.cell_m,
            visible=visible,
        )

    @property
    def camera(self) -> Floats:
        """(4,) place of the camera, and the last of `middle`."""
        return np.asarray(self.middle - np.array([0.0, self.distance, 0.0, 0.0]))

    @property
    def is_enclosed(self) -> bool:
        """True if the background surrounds everything."""
        return bool(np.isinf(self.disc[3]))

    def places(self, across: int) -> Floats:
        """Rays (across^2, 4) of a pixel: right and down of its corner, in pixels, where they cross
        the target plane; and the points of the aperture that they pass, right and up, in cells.

        Rays of all points of the aperture through one place in the plane in focus form one point.
        """
        if self.regular:
            place = (np.arange(across) + 0.5) / across
            down, right = np.meshgrid(place, place, indexing="ij")
            in_pixel = np.stack([right.ravel(), down.ravel()], axis=1)
            return np.hstack([in_pixel, np.zeros((across**2, 2))])
        points = net(across**2)
        lens = self.aperture * on_disc(points[:, 2:])
        shift = (1.0 - self.distance / self.focus) * lens / np.array(self.pitch)
        return np.hstack([points[:, :2] + shift * (1.0, -1.0), lens])

    def rays(self, across: Ints) -> tuple[Floats, NDArray[np.int32]]:
        """`places` (R, 4) of pixels with `across`^2 (N,) rays each, and those (N, 2) of each pixel:
        the number of the first, and how many they are."""
        numbers, position = np.unique(across, return_inverse=True)
        ranges = np.stack([np.cumsum(numbers**2) - numbers**2, numbers**2], axis=1)
        places = [np.zeros((0, 4)), *(self.places(int(number)) for number in numbers)]
        return np.concatenate(places), ranges.astype(np.int32)[position]

    def tile_of(self, pixels: Ints, edge: int = 8) -> Ints:
        """Numbers (N,) of the tiles of `edge` x `edge` pixels that contain the pixels (N,)."""
        row, column = np.divmod(pixels, self.pixels[0])
        return np.asarray(row // edge * self.pixels[0] + column // edge)

    def tiles(
        self, program: Program, kernel: str, rows: int | None = None
    ) -> tuple[tuple[int, int], tuple[int, int]]:
        """Global size and work-group size (columns, rows) of a kernel with an item for each pixel.

        The image has `rows` rows; None: all.
        """
        columns, all_rows = self.pixels
        edge = 8
        while edge > 1 and edge**2 > program.largest_group(kernel):
            edge //= 2
        return (columns, all_rows if rows is None else rows), (edge, edge)

    @cached_property
    def sees_background(self) -> Mask:
        """Mask (H, W) of pixels in front of the background: it ends their line of sight."""
        columns, rows = self.pixels
        pixel_numbers = np.arange(columns * rows)
        return np.asarray(
            self.boundary_shares(pixel_numbers, np.ones_like(pixel_numbers))[0] > 0
        ).reshape(rows, columns)

    @cached_property
    def sees_background_alone(self) -> Mask:
        """Mask (H, W) of pixels all of whose rays end on the background, without the medium."""
        return ~dilated(~self.sees_background, self.edge_pixels)

    @property
    def edge_pixels(self) -> int:
        """Pixels by which the lens blurs the edges of the boundary, at most."""
        return self.blur_pixels(self.disc[1], *self.patches[:, 1, 1])

    def blur_pixels(self, *y: float) -> int:
        """Pixels, rounded up, by which the lens blurs an edge in any of the planes `y`."""
        plane_distance = self.distance + np.asarray(y) - self.middle[1]
        radius = self.aperture * np.abs(self.distance / plane_distance - self.distance / self.focus)
        return int(np.ceil(radius.max() / min(self.pitch)))

    def on_background(self, pixels: Ints) -> Mask:
        """Mask (N,) of pixels in front of the background, by flat number (N,)."""
        return np.asarray(self.sees_background.reshape(-1)[pixels])

    def has_temperature(self, emissivity: Reals, pixels: Ints) -> Mask:
        """Pixels (N,) that see the background, with an emissivity (N,) above `visible`."""
        out = np.asarray(emissivity > self.visible)
        out[out] = self.on_background(pixels[out])
        return out

    def boundary_shares(self, pixels: Ints, across: Ints) -> Floats:
        """Shares (B, ..., N) of background, wall and patches in pixels (N,), without the medium.

        `across`^2 (..., N) lines of sight go through each pixel.
        """
        device = self.device
        patches = len(self.patches)
        defines = {"N_PATCHES": patches, "USE_FLOAT64": int(device.info.float64)}
        defines = {name: count for name, count in defines.items() if count}
        program = build(device, "boundary_shares.cl", defines)
        listed, parts = np.broadcast_to(pixels, across.shape).reshape(-1), 2 + patches
        places, ranges = self.rays(across.reshape(-1))
        out = unset(device, "shares of the boundary", parts * len(listed), np.int32)
        if len(listed):
            program.launch(
                "boundary_shares",
                (len(listed),),
                (min(GROUP, program.largest_group("boundary_shares")),),
                {
                    "seen": out,
                    "list": upload(device, "pixels", listed.astype(np.int32)),
                    "count": len(listed),
                    "places": upload(device, "rays", places.astype(program.real)),
                    "ranges": upload(device, "rays", ranges),
                    **self.lines_of_sight(device, program.real),
                },
            )
        ends = download(device, out, np.empty((parts, len(listed)), np.int32))
        return (ends / ranges[:, 1]).reshape(parts, *across.shape)

    def geometry(
        self, device: Device, cells: OpticalCells, real: type[np.floating]
    ) -> dict[str, Any]:
        """Kernel arguments of the octree's size and of `lines_of_sight`."""
        bounds = cells.bounds()
        return {
            "coarse": cells.tree.slots * CELLS_PER_BRICK,
            "stored": len(cells.depth),
            "bricks": cells.tree.frame.bricks,
            "low": np.array([*bounds.low, 0], np.int32),
            "high": np.array([*np.add(bounds.low, bounds.shape), 0], np.int32),
            **self.lines_of_sight(device, real),
        }

    def lines_of_sight(self, device: Device, real: type[np.floating]) -> dict[str, Any]:
        """Kernel arguments of camera, disc and patches, in the type `real`."""
        out = {
            "columns": self.pixels[0],
            "rows": self.pixels[1],
            "middle": self.middle.astype(real),
            "pitch_x": float(self.pitch[0]),
            "pitch_z": float(self.pitch[1]),
            "distance": float(self.distance),
            "disc": self.disc.astype(real),
        }
        if len(self.patches):
            out["patches"] = upload(device, "patches", self.patches.astype(real))
        return out


def upload_tree(
    device: Device, cells: OpticalCells, real: type[np.floating], *, linear: bool = False
) -> dict[str, Any]:
    """Kernel arguments of the octree and its optical depths; `linear`: with their gradients."""
    buffers = device_cells(device, cells, real, linear=linear)
    return {name: buffers[name] for name in buffers.keys() - {"corners", "albedo", "thermal"}}


def upload_medium(
    device: Device, cells: OpticalCells, view: View, real: type[np.floating], *, linear: bool
) -> dict[str, Any]:
    """Kernel arguments of paths: the octree with thermal sources and albedos, and the geometry.

    `linear`: the extinction is linear within cells.
    """
    buffers = device_cells(device, cells, real, linear=linear)
    tree = {name: buffers[name] for name in buffers.keys() - {"corners"}}
    return {**tree, **view.geometry(device, cells, real)}


def check_boundary(scene: Scene, cells: OpticalCells, view: View) -> None:
    """Raises TransportError if the disc or a patch is inside the medium.

    The medium may end anywhere in its last cells. A disc within these is allowed, since rays are
    followed back to it; a patch is not.
    """
    frame, box = cells.tree.frame, cells.box()
    low, high = np.asarray(box.low, float), np.add(box.low, box.shape).astype(float)
    if not view.is_enclosed and view.disc[1] < high[1] - 1.0:
        reach = frame.lower_m[1] + high[1] * frame.cell_m
        raise TransportError(
            f"background.centre_m: y = {scene.background_centre_m[1]:g} m is inside the spray, "
            f"which reaches to y = {reach:.4g} m; allowed: a disc behind it"
        )
    for patch, rows in zip(scene.patches, view.patches, strict=True):
        normal, offset = rows[0, :3], rows[0, 3]
        depth = offset - float(normal @ np.where(normal > 0, low, high))
        if depth > 1e-6:
            raise TransportError(
                f"patches.{patch.name}: its plane cuts {depth * frame.cell_m:.4g} m into the box "
                "around the spray; allowed: a patch with the whole spray in front of it"
            )
