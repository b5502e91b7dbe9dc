"""Differences of two pictures: in kelvin, beside stated errors, on the same pixels or refused."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.accuracy.errors import OMISSION, Cause, Errors
from cldit.camera.curve import Curve
from cldit.comparison import Shown, compare, difference, open_shown
from cldit.comparison.pixels import together
from cldit.comparison.regions import positions_m, shape_of
from cldit.comparison.shared import unshared
from cldit.dit.budget import Part
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError, RunFolderError
from cldit.io.origin import Origin, code
from cldit.radiance.weights import Weights
from cldit.run import Run, open_run, reevaluated
from cldit.scene import load_scene
from cldit.scene.keys import key_differences
from cldit.show.report.comparison_page import write_comparison

WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"
PIXEL_M = (1e-3, 2e-3)


def maps(t_app: NDArray[np.float64], emissivity: float = 0.5) -> Maps:
    warm = t_app.astype(np.float32)
    one = np.full(t_app.shape, emissivity, np.float32)
    error = np.full(t_app.shape, 0.5, np.float32)
    reason = np.where(np.isfinite(warm), 0, 5).astype(np.uint8)
    return Maps(one, warm, error, error, reason, error, error, error)


def shown(t_app: NDArray[np.float64], **more: Any) -> Shown:
    given: dict[str, Any] = {"name": "a", "pixel_m": PIXEL_M, "centre_m": (0.0, 0.0)}
    return Shown(maps=maps(t_app), **{**given, **more})


def test_rms_mean_worst_and_its_place() -> None:
    before = np.full((4, 6), 400.0)
    after = before + 1.0
    after[1, 5] += 3.0
    before[0, 0] = after[3, 3] = np.nan
    found = difference(shown(before), shown(after)).t_app
    change = np.array([1.0] * 21 + [4.0])
    assert found.pixels == 22
    assert found.rms == pytest.approx(np.sqrt(np.mean(change**2)), rel=1e-6)
    assert found.mean == pytest.approx(change.mean(), rel=1e-6)
    assert found.worst == 4.0
    assert found.worst_mm == pytest.approx((2.5, 1.0))  # column 5 of 6, row 1 of 4, row 0 on top


def test_pixels_of_one_alone_are_counted() -> None:
    before, after = np.full((2, 3), 400.0), np.full((2, 3), 400.0)
    before[0, 0] = after[1, 1] = after[1, 2] = np.nan
    found = difference(shown(before), shown(after))
    assert found.only == (2, 1)
    assert not found.same


def with_causes(*causes: Cause, **keys: Any) -> Run:
    """The written run with these errors, in memory, and with other keys of its scene."""
    run = open_run(WRITTEN)
    info = replace(run.info, errors=Errors(causes), plan={})
    return replace(run, scene=run.scene.with_(**keys), folder=None, info=info, error_maps={})


def noise(seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal((40, 40))


@pytest.mark.parametrize(
    ("errors", "within_K", "within", "words"),
    [
        ((0.6, 0.8), None, True, "no difference is seen (p = 0."),
        (
            (0.6, 0.6),
            None,
            False,
            "(p < 1e-9): T_app",
        ),
        ((None, 2.0), None, False, "no error is stated"),
        ((None, None), 2.5, True, "within the 2.5 K RMS allowed"),
        ((9.0, 9.0), 0.5, False, "beyond the 0.5 K RMS"),
    ],
)
def test_stated_errors_explain_or_do_not(
    errors: tuple[float | None, float | None], within_K: float | None, within: bool, words: str
) -> None:
    """Noise of 1 K: of 1600 pixels, errors of 0.85 K explain it with a probability of 1e-30."""
    one = shown(400.0 + 0.0 * noise(1), error_K=errors[0])
    other = shown(400.0 + noise(1), error_K=errors[1])
    found = difference(one, other, within_K=within_K)
    assert found.within is within and words in found.verdict.text
    data = found.to_dict()
    assert data["within"] is within and set(data["regions"]["all"]) >= {"rms_K", "p_value"}


def test_regions_name_where_a_difference_is() -> None:
    """Pixels of 1 mm around a tip in the 3rd row: 8 mm below it, and beyond 85 % of the reach."""
    warm = 400.0 + noise(2)
    given: dict[str, Any] = {"pixel_m": (1e-3, 1e-3), "centre_m": (0.0, -17e-3)}
    one, same = shown(400.0 + 0 * warm, error_K=1.0, **given), shown(warm, error_K=0.0, **given)
    assert difference(one, same).within
    warmer = warm.copy()
    warmer[4:11] += 1.0  # 1 to 8 mm below the tip
    found = difference(one, shown(warmer, error_K=0.0, **given))
    assert found.where == ("root",) and not found.within
    root = found.regions["root"]
    assert root.pixels == 7 * 40 and root.mean == pytest.approx(1.0, abs=0.2)
    assert root.mean_error == pytest.approx(280**-0.5, rel=0.1)
    inside = [one.pixels for name, one in found.regions.items() if name != "all"]
    assert sum(inside) == found.regions["all"].pixels == 1600


def test_an_error_of_all_pixels_explains_what_they_share() -> None:
    """2 K everywhere, by a black body that is 2 K off: stated as 1 K, or as none."""
    image = 400.0 + noise(3)
    one = shown(400.0 + 0 * image, error_K=1.0)
    part = Part(name="black body", kelvin=1.0 + 0 * image, emissivity=0 * image)
    other = shown(image + 2.0, error_K=0.0)
    assert not difference(one, other).within
    found = difference(one, replace(other, systematic=(part,)))
    assert found.within and found.modes[0].size == pytest.approx(-2.0, abs=0.1)
    assert found.regions["all"].mean_error == pytest.approx(1.0, abs=0.01)
    both = difference(replace(one, systematic=(part,)), replace(other, systematic=(part,)))
    assert not both.within  # the same black body: it cancels
    far = difference(one, replace(shown(image + 5.0, error_K=0.0), systematic=(part,)))
    assert not far.within  # five times as far off as stated
    assert far.verdict.causes == ()  # of more than five deviations
    near = difference(one, replace(shown(image + 4.0, error_K=0.0), systematic=(part,)))
    best = near.verdict.causes[0]
    assert best.name == "black body" and best.unit == "stated deviations"
    assert best.size == pytest.approx(-4.04, abs=0.1) and best.error == pytest.approx(0.025, 0.1)


def test_no_pixel_in_both() -> None:
    """Nothing is the same, and no error explains it."""
    nothing = np.full((2, 2), np.nan)
    one, other = shown(nothing, error_K=None), shown(np.full((2, 2), 400.0), error_K=1.0)
    for pair in ((one, other), (other, one)):
        found = difference(*pair)
        assert (found.t_app.pixels, found.p_value, found.within) == (0, None, False)
        assert found.verdict.text == "no pixel has a T_app in both"
        with pytest.raises(EvaluationError, match="no pixel has a T_app: transparent"):
            compare(*pair)
    assert difference(one, shown(nothing)).verdict.text == "the same in every pixel"


def test_what_has_no_meaning_is_refused() -> None:
    warm = np.full((4, 4), 400.0)
    one = shown(warm, error_K=1.0, filter_um=(3.3, 3.5))
    with pytest.raises(EvaluationError, match=r"3.3 to 3.5 um, b has 3 to 5 um"):
        compare(one, shown(warm, name="b", filter_um=(3.0, 5.0)))
    with pytest.raises(EvaluationError, match="one result alone"):
        compare(one)
    halves = warm.copy(), warm.copy()
    halves[0][:2] = halves[1][2:] = np.nan
    with pytest.raises(EvaluationError, match="no pixel is visible in both"):
        compare(shown(halves[0], error_K=1.0), shown(halves[1], error_K=1.0))


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match=str(tmp_path)):
        difference(tmp_path, WRITTEN)


def test_a_run_is_its_own_like() -> None:
    found = difference(WRITTEN, open_run(WRITTEN))
    assert found.same and found.within and found.keys == ()
    assert found.verdict.text == "the same in every pixel"


def test_other_pixels_are_refused() -> None:
    one = shown(np.full((2, 2), 400.0))
    for other, problem in (
        (shown(np.full((2, 3), 400.0)), "must cover the whole of the other image"),
        (shown(np.full((2, 2), 400.0), centre_m=(1e-3, 0.0)), "the centres must be the same"),
    ):
        with pytest.raises(EvaluationError, match=f"2 x 2 pixels over .* {problem}"):
            difference(one, other)
    coarse = shown(np.full((1, 1), 400.0), pixel_m=(2e-3, 4e-3))
    with pytest.raises(EvaluationError, match="the filter of a, the finer one, is unknown"):
        difference(one, coarse)


def test_a_finer_recording_is_averaged_in_radiance() -> None:
    """Blocks of 2 x 2 pixels: half of the noise, all of a common error, the mean of e B(T_app)."""
    filter_um = (3.3, 3.5)
    curve = Curve(filter_um=filter_um)
    warm: Any = np.kron(400.0 + 10.0 * np.arange(6.0).reshape(2, 3), np.ones((2, 2)))
    warm[0, 0], warm[3, 5] = 470.0, np.nan
    common = Part(name="common error 1", kelvin=0.3 + 0.0 * warm, emissivity=0.1 + 0.0 * warm)
    error_K = np.where(np.isfinite(warm), 0.5, np.nan)
    fine = shown(warm, error_map_K=error_K, common=(common,), filter_um=filter_um)
    coarse = shown(np.full((2, 3), 400.0), pixel_m=(2e-3, 4e-3), error_map_K=np.ones((2, 3)))
    for pair, name in (((fine, coarse), 0), ((coarse, fine), 1)):
        *both, words = together(*pair)
        found = both[name]
        assert words.startswith("a averaged onto 3 x 2 pixels")
        kelvin = found.maps.apparent_temperature_K
        first = curve.temperature(np.mean(curve.radiance(np.array([470.0, 400.0, 400.0, 400.0]))))
        assert kelvin[0, 0] == pytest.approx(float(first), abs=1e-3)
        assert kelvin.ravel()[1:5] == pytest.approx([410.0, 420.0, 430.0, 440.0], abs=1e-3)
        assert kelvin[1, 2] == pytest.approx(450.0, abs=1e-3)  # of three quarters
        assert found.error_map_K is not None
        independent = 0.5**2 - 0.3**2
        assert found.error_map_K[0, 1] == pytest.approx(np.sqrt(independent / 4.0 + 0.3**2))
        assert found.common[0].kelvin[0, 1] == pytest.approx(0.3)
        error = found.maps.emissivity_standard_error[0, 1]
        assert error == pytest.approx(np.sqrt((0.5**2 - 0.1**2) / 4.0 + 0.1**2))


def finer(run: Run) -> Run:
    """The same picture with four pixels for each."""

    def four(weights: Weights) -> Weights:
        return weights.map(lambda image: np.kron(image, np.ones((2, 2), np.float32)))

    columns, rows = run.scene.camera.pixels
    fine = {
        name: np.kron(image, np.ones((2, 2), image.dtype)) for name, image in vars(run.maps).items()
    }
    return replace(
        run,
        maps=Maps(**fine),
        scene=run.scene.with_(**{"camera.pixels": [2 * columns, 2 * rows], "name": "finer"}),
        weights=four(run.weights),
        reference=four(run.reference),
        spectral=tuple(four(one) for one in run.spectral),
    )


@pytest.mark.parametrize("swap", [False, True])
def test_a_finer_trace_is_averaged(swap: bool) -> None:
    """Each pixel's mean is the coarse pixel, so nothing differs but rounding of float32."""
    run = open_run(WRITTEN)
    pair = [finer(run), run][:: -1 if swap else 1]
    found = difference(*pair)
    assert "finer averaged onto 12 x 10 pixels" in found.averaged
    assert found.only == (0, 0) and found.t_app.rms is not None and found.t_app.rms < 0.01
    assert {key.key for key in found.keys} == {"name", "camera.pixels"}


def test_a_run_beside_its_own_measurement(tmp_path: Path) -> None:
    """The trace, averaged onto the sensor's pixels, is what the rig recorded, within its noise."""
    folder = Path(shutil.copytree(WRITTEN, tmp_path / "run"))
    run, recorded = open_shown(folder), open_shown(folder / "acquisition")
    assert run.run is not None and recorded.run is None
    found = difference(folder, folder, acquired=True)
    assert found.same
    found = difference(folder, folder / "acquisition")
    assert found.averaged.startswith(f"{folder} averaged onto 16 x 12 pixels over 160 x 120 mm")
    assert found.within and found.t_app.pixels > 10
    # Both contain the errors of the trace: the noise of the recording is all that is counted.
    assert found.unshared_K == (0.0, recorded.error_K)
    shutil.rmtree(folder / "acquisition" / "maps")
    with pytest.raises(RunFolderError, match="not evaluated yet"):
        open_shown(folder / "acquisition")
    with pytest.raises(RunFolderError, match="has no acquisition"):
        difference(folder, folder, acquired=True)


def test_keys_that_differ() -> None:
    gdi = load_scene("gdi-cone")
    other = gdi.with_(**{"walls.temperature_K": 500, "camera.pixels": [3, 4]})
    texts = [one.text for one in key_differences(gdi, other)]
    columns, rows = gdi.camera.pixels
    assert texts == [
        f"camera.pixels: [{columns}, {rows}] and [3, 4]",
        f"walls.temperature_K: {gdi.walls.temperature_K:g} and 500",
    ]
    names = [one.key for one in key_differences(gdi, load_scene("methane-jet"))]
    assert any(name.startswith("spray.plumes[") for name in names) and len(names) > 5


def test_errors_that_both_share_do_not_explain_a_difference() -> None:
    """The same pixels and cells at another order: only the trace's own errors are independent."""
    causes = (
        Cause("cells", 3.0, "", shared_by="cells", emissivity=0.04),
        Cause("pixel sampling", 2.0, "", shared_by="pixels", emissivity=0.02),
        Cause("trace", 0.5, "", shared_by="seed", emissivity=0.01),
        Cause("gas grid", None, "", shared_by="spray"),
    )
    run = with_causes(*causes)
    found = difference(run, with_causes(*causes, **{"transport.order": 1}))
    assert found.shared == ("cells", "gas grid", "pixel sampling")
    assert found.unshared_K == (0.5, 0.5) and not found.at_least
    assert found.unshared_emissivity == (0.01, 0.01)
    assert found.stated_K == pytest.approx((13.25**0.5, 13.25**0.5))
    finer = with_causes(*causes, **{"camera.rays_per_pixel": 4})
    assert difference(run, finer).unshared_K == pytest.approx((4.25**0.5, 4.25**0.5))
    found = difference(run, with_causes(*causes, **{"spray.time_s": 0.9e-3}))
    assert found.shared == () and found.at_least and found.unshared_K == found.stated_K


def test_pixel_sampling_is_shared_where_the_rays_are_the_same() -> None:
    """The rays that each image chose for itself are compared in every pixel."""
    causes = Cause("pixel sampling", 2.0, "", shared_by="pixels"), Cause("trace", 0.5, "")
    one, other = (
        with_causes(*causes, **{"transport.order": order, "camera.rays_per_pixel": "auto"})
        for order in (3, 4)
    )
    map_K = np.full(one.maps.reason.shape, 2.0, np.float32)
    one, other = (
        replace(each, error_maps={"pixel sampling": map_K, "total": np.hypot(map_K, 0.5)})
        for each in (one, other)
    )
    assert difference(one, other).shared == ()  # not recorded, as in old runs
    rays = np.ones_like(map_K)
    same = replace(one, rays=rays), replace(other, rays=rays)
    assert difference(*same).shared == ("pixel sampling",)
    more = rays.copy()
    more[2:, 3] = 4.0
    found = difference(same[0], replace(other, rays=more))
    assert found.shared == ("pixel sampling in 112 of 120 pixels",)
    for each in found.seen:
        counted = each.error_map_K
        assert counted is not None
        assert counted[more == 1.0] == pytest.approx(0.5)
        assert counted[more > 1.0] == pytest.approx(np.hypot(2.0, 0.5))


def test_half_of_an_error_of_unknown_image_is_common() -> None:
    """Against a measurement: cells are wrong alike in whole areas, rays in each pixel."""
    causes = Cause("cells", 3.0, "", shared_by="cells"), Cause("trace", 0.5, "", shared_by="seed")
    run = with_causes(*causes, **{"transport.order": None})
    whole = np.full(run.maps.reason.shape, float(np.hypot(3.0, 0.5)))
    run = replace(run, error_maps={"total": whole.astype(np.float32)})
    counted = unshared(replace(open_shown(run), name="model"), shown(whole)).baseline
    (part,) = counted.common
    assert part.name == "cells" and part.kelvin == pytest.approx(3.0 * 0.5**0.5)
    assert counted.error_map_K == pytest.approx(np.hypot(3.0, 0.5))
    assert counted.independent_variance() == pytest.approx(4.5 + 0.25)


def test_what_the_code_changed_is_not_shared() -> None:
    """Another commit alone shares nothing; with digests, all but what the changed room makes."""
    old = open_run(WRITTEN)
    causes = tuple(Cause(name, 1.0, "", shared_by=name) for name in ("spray", "cells", "seed"))

    def computed(code: dict[str, str], commit: str) -> Run:
        origin = replace(Origin.now(), commit=commit, code=code)
        info = replace(old.info, errors=Errors(causes), origin=origin)
        return replace(old, folder=None, info=info, error_maps={})

    one, whole = computed({}, "a"), dict.fromkeys(code(), "1")
    assert difference(one, computed({}, "a")).shared == ("cells", "seed", "spray")
    assert difference(one, computed({}, "b")).shared == ()
    one = computed(whole, "a")
    for room, shared in (("medium", ("spray",)), ("transport", ("cells", "spray")), ("spray", ())):
        found = difference(one, computed({**whole, room: "2"}, "b"))
        assert (found.shared, found.code) == (shared, (room,))


def test_what_one_alone_omits_is_tested_and_no_error() -> None:
    """An omission is the same in every repetition of a run, so it explains no difference."""
    trace, name = Cause("trace", 0.5, "", shared_by="seed"), "orders of scattering"
    for error_K in (3.0, None):
        omitted = Cause(name, error_K, "", "transport.order", shared_by=OMISSION)
        whole = with_causes(trace, **{"transport.order": None})
        first, second = (with_causes(trace, omitted, **{"transport.order": n}) for n in (1, 2))
        for pair in ((first, whole), (whole, first), (first, second)):
            found = difference(*pair)
            assert found.unshared_K == (0.5, 0.5) and not found.at_least
            assert (found.tested, found.shared) == ((name,), ())
        found = difference(first, with_causes(trace, omitted, **{"transport.order": 1}))
        assert (found.tested, found.shared) == ((), (name, "trace"))


def test_a_recording_has_the_errors_of_its_trace_in_every_pixel(tmp_path: Path) -> None:
    """Against another run: its noise and the trace's own error, 0.5 K, in quadrature."""
    folder = Path(shutil.copytree(WRITTEN, tmp_path / "run"))
    trace = Cause("trace", 0.5, "", shared_by="seed")
    other, mine = (with_causes(trace, **{"transport.order": order}) for order in (3, 4))
    recorded = replace(open_shown(folder / "acquisition"), traced=mine)
    assert recorded.error_map_K is not None
    counted = unshared(open_shown(other), recorded).compared
    assert counted.error_map_K == pytest.approx(np.hypot(recorded.error_map_K, 0.5), nan_ok=True)


def test_a_line_is_a_run_with_one_quantity_changed() -> None:
    """A measurement that lies between a run and its variant is explained by half a spread."""
    run = with_causes(Cause("trace", 0.2, ""))
    warm = run.maps.apparent_temperature_K
    variant = replace(run, maps=replace(run.maps, apparent_temperature_K=warm + np.float32(8.0)))
    x, _, z = run.scene.target_m
    given: dict[str, Any] = {"pixel_m": run.pixel_m, "centre_m": (x, z), "error_K": 0.5}
    measured = Shown(
        name="measured",
        maps=replace(run.maps, apparent_temperature_K=warm + np.float32(4.0)),
        noisy=True,
        walls_spread_K=3.0,
        **given,
    )
    assert compare(measured, run).differs
    found = compare(measured, run, lines={"k": variant})
    assert not found.differs
    sizes = {one.name: one.size for one in found.differences[0].modes}
    assert sizes["k"] == pytest.approx(0.5, abs=0.1) and "walls by 3 K" in sizes
    with pytest.raises(EvaluationError, match="line k: measured is no run"):
        compare(measured, run, lines={"k": measured})


@pytest.mark.parametrize("swap", [False, True])
def test_warmer_walls_are_named_with_their_size(swap: bool) -> None:
    """20 K in a trace of 0.05 K: by the exact change, since the derivative is 20 % off at 450 K.

    Scattered light of the walls is the tenth of the droplets' light in the written run.
    """
    run = with_causes(Cause("trace", 0.05, "", shared_by="seed"))
    run = reevaluated(run, run.scene)  # its maps are those of an older version
    walls_K = run.scene.walls.temperature_K
    warmer = reevaluated(run, run.scene.with_(**{"walls.temperature_K": walls_K + 20.0}))
    pair = (warmer, run) if swap else (run, warmer)
    shown = [replace(open_shown(each), error_map_K=None) for each in pair]
    found = difference(replace(shown[0], error_K=0.05), replace(shown[1], error_K=0.05))
    verdict = found.verdict
    assert verdict.differs and verdict.lines[0].startswith("keys: walls.temperature_K: ")
    best = verdict.causes[0]
    assert (best.name, best.unit) == ("walls", "K")
    assert best.size == pytest.approx(-20.0 if swap else 20.0, abs=0.1)
    assert best.error < 2.0 and best.p_value > 0.01


def test_errors_that_hide_all_leave_no_power() -> None:
    """Noise of 0.1 K with stated errors of 3 K: p is above 0.99, which is no agreement."""
    one = shown(400.0 + 0.1 * noise(6), error_K=3.0)
    verdict = difference(one, shown(400.0 + 0.0 * noise(6), error_K=0.0)).verdict
    assert not verdict.differs and not verdict.power
    assert verdict.text.startswith("no power (p > 0.99): T_app ")
    assert "p = 1" not in verdict.text and verdict.seen is not None
    # 1600 pixels of 3 K in 4 parts: 5.8 to 6.6 errors of the mean, by the F test's directions.
    assert verdict.seen == pytest.approx(6.2 * 3.0 / 40.0, rel=0.15)


def test_a_copied_recording_knows_its_run(tmp_path: Path) -> None:
    """The rig file of a simulated rig names the run, whose errors both have."""
    folder = Path(shutil.copytree(WRITTEN, tmp_path / "run"))
    copied = Path(shutil.copytree(folder / "acquisition", tmp_path / "elsewhere"))
    inside = difference(folder, folder / "acquisition")
    assert difference(folder, copied).unshared_K != inside.unshared_K
    rig = copied / "rig.yaml"
    rig.write_text(rig.read_text().replace("FOLDER", str(folder)))
    found = difference(folder, copied)
    assert found.unshared_K == inside.unshared_K and found.p_value == inside.p_value


def test_a_page_has_both_and_the_regions(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    warm = 400.0 + noise(5)
    one, other = shown(0 * warm + 400.0, error_K=1.0), shown(warm, name="b", error_K=0.0)
    found = compare(one, other, other)
    *figures, page_file = write_comparison(found, tmp_path / "out", suffix=".pdf")
    names = ["difference", "profiles", "difference-2", "profiles-2"]
    assert [path.name for path in figures] == [f"{name}.pdf" for name in names]
    assert all(path.read_bytes().startswith(b"%PDF") for path in figures)
    page = page_file.read_text()
    assert "b minus a" in page and found.differences[0].verdict.text in page
    table = (tmp_path / "out" / "regions.csv").read_text().splitlines()
    assert len(table) == 1 + 2 * 5 and table[1].startswith("a,b,all,1600,")
    lines = (tmp_path / "out" / "profiles.csv").read_text().splitlines()
    listed = found.to_dict()["comparisons"]
    points = [len(each["profiles"][name]["change_K"]) for each in listed for name in _LINES]
    assert len(points) == 4 and len(lines) == 1 + sum(points)
    data = found.to_xarray()
    assert isinstance(data, xarray.Dataset) and dict(data.sizes) == {"other": 2, "z": 40, "x": 40}
    np.testing.assert_allclose(data.change_K[0], found.differences[0].change_K)


_LINES = ("axis", "across")


@pytest.mark.parametrize("centre_m", [(0.02, -0.03), (0.03, -0.05)], ids=["tip", "no tip"])
def test_profiles_follow_the_axis_with_the_errors_of_both(centre_m: tuple[float, float]) -> None:
    """A sector of 40 degrees around 30, warmer by 1 K/mm; 0.6 K, 0.8 K and 2 K in all pixels."""
    place: dict[str, Any] = {"pixel_m": (0.5e-3, 0.5e-3), "centre_m": centre_m}
    x_m, z_m = positions_m((160, 160), **place)
    far_m, angle = np.hypot(x_m, z_m), np.degrees(np.arctan2(x_m, -z_m))
    inside = (np.abs(angle - 30.0) < 20.0) & (far_m < 0.06)
    warm = np.where(inside, 400.0 + 1e3 * far_m, np.nan)
    same = Part(name="common error 1", kelvin=np.full(warm.shape, 2.0), emissivity=0.0 * warm)
    part = Part(name="walls", kelvin=np.full(warm.shape, 0.8), emissivity=np.full_like(warm, 1.2))
    one = shown(warm, error_K=0.6, **place)
    map_K = np.full(warm.shape, np.hypot(0.8, 2.0))
    other = shown(
        warm + 3.0, error_map_K=map_K, common=(same,), systematic=(part,), name="b", **place
    )
    found = difference(one, other).profiles
    axis, across = (found[name] for name in _LINES)
    seen = np.isfinite(axis.change_K)
    pixel_m = 0.5e-3
    assert axis.one.distance_m == pytest.approx(np.hypot(axis.one.x_m, axis.one.z_m))
    along = np.degrees(np.arctan2(axis.one.x_m, -axis.one.z_m))[1:]
    assert along == pytest.approx(30.0, abs=0.5)
    expected_K = 400.0 + 1e3 * axis.one.distance_m
    assert axis.one.apparent_temperature_K[seen] == pytest.approx(expected_K[seen], abs=0.4)
    assert seen.sum() == pytest.approx((0.06 - axis.one.distance_m[0]) / pixel_m, abs=3)
    assert axis.one.apparent_temperature_standard_error_K == pytest.approx(0.6)
    second = np.sqrt(0.8**2 + 2.0**2 + 0.8**2)  # the systematic one is not in the map
    assert axis.other.apparent_temperature_standard_error_K == pytest.approx(second)
    assert axis.emissivity_change_error == pytest.approx(np.sqrt(0.5**2 + 0.5**2 + 1.2**2))
    for each in (axis, across):
        here = np.isfinite(each.change_K)
        assert each.change_K[here] == pytest.approx(3.0)
        assert each.change_error_K[here] == pytest.approx(np.hypot(0.6, second), abs=1e-4)
    middle = np.argmin(np.abs(across.one.distance_m))
    half_m = 0.06 * 0.97**0.5 / 2.0
    x, z = across.one.x_m[middle], across.one.z_m[middle]
    assert np.hypot(x, z) == pytest.approx(half_m, abs=pixel_m)
    wide_m = across.one.distance_m[np.isfinite(across.change_K)]
    expected_m = half_m * np.tan(np.radians(20.0))
    assert np.abs(wide_m).max() == pytest.approx(expected_m, abs=2 * pixel_m)
    assert wide_m.min() == pytest.approx(-expected_m, abs=2 * pixel_m)


def test_area_and_penetration_of_a_disc() -> None:
    """Around a tip in the middle: 97 % of a disc of radius R lie within 0.985 R."""
    x_m, z_m = positions_m((80, 80), pixel_m=(1e-3, 1e-3), centre_m=(0.0, 0.0))
    inside = np.hypot(x_m, z_m) < 0.03
    found = shape_of(shown(np.where(inside, 400.0, np.nan), pixel_m=(1e-3, 1e-3)))
    assert found["penetration_mm"][0] == pytest.approx(30 * 0.97**0.5, abs=0.5)
    assert found["penetration_mm"][1] == 0.5
    wedge = inside & (np.abs(x_m) < -z_m)  # a quarter
    found = shape_of(shown(np.where(wedge, 400.0, np.nan), pixel_m=(1e-3, 1e-3)))
    assert found["angle_deg"][0] == pytest.approx(0.95 * 90.0, abs=3.0)
    assert found["visible_area_mm2"][0] == 6400.0  # emissivity 0.5 everywhere
