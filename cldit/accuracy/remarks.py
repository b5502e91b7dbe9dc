"""Remarks on the error of a run: refinements, unknown parts, and what exceeds the tolerance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from cldit.accuracy.errors import Errors
from cldit.accuracy.sources import SOURCES
from cldit.scene import Scene

if TYPE_CHECKING:
    from cldit.accuracy.converge import Result


def refinement(errors: Errors, number: int, most: int) -> tuple[str, ...]:
    """Remark that the image is traced again."""
    largest = errors.largest()
    by = "" if largest is None else f", {largest.text} of it by {largest.name}"
    return (f"error {errors.text}{by}: refinement {number} of at most {most}",)


def kept(before: Errors, errors: Errors) -> tuple[str, ...]:
    """Remark that a refinement is discarded."""
    return (
        f"refinement did not help (error {errors.text}): the previous image is kept "
        f"({before.text})",
    )


def final(scene: Scene, result: Result) -> Iterator[str]:
    """Remarks on unknown errors, and on an error that exceeds the tolerance."""
    error, transport = result.trace_error, scene.transport
    yield from result.traces.short
    if not transport.audit:
        yield from () if error is None else error.remarks(transport)
        return
    if result.errors.why:
        yield f"error of T_app: {result.errors.text}"
        return
    yield from () if error is None else error.unknown_remarks
    yield from too_large(result.errors, transport.accuracy_K, result.resolution.limits)


def too_large(
    errors: Errors, tolerance_K: float, limits: Mapping[str, str] | None = None
) -> tuple[str, ...]:
    """Remark that the error exceeds the tolerance, with its largest source and a remedy.

    `limits` has the reason why a source cannot be made smaller, by its name.
    """
    largest = errors.largest()
    if largest is None or not errors.exceed(tolerance_K):
        return ()
    remedies = {name: one.remedy for one in SOURCES for name in (one.name, *one.also)}
    remedy = remedies.get(largest.name, {"": "a larger transport.accuracy_K"})
    why = f"allowed: {remedy.get(largest.fixed, remedy[''])}"
    why = (limits or {}).get(largest.name, why)
    held = f", set by {largest.fixed}" if largest.fixed else ""
    return (
        f"stated error {errors.text} RMS, more than transport.accuracy_K: {tolerance_K:g} asks "
        f"for: {largest.name} contribute{'' if largest.name.endswith('s') else 's'} "
        f"{largest.text}{held}; {why}",
    )
