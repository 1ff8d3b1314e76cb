"""The gate before anything is computed from a marker recording: whether its points can be a person's body."""

from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality.body import rightward, side_exchanges, stature_found
from lumbar.lifting.quality.displacement import (
    displacements,
    length,
    off_its_part,
    steadiest_mate,
)
from lumbar.lifting.quality.landmarks import landmarks, side_pairs
from lumbar.lifting.quality.leaps import (
    Exchange,
    Leap,
    find_leaps,
    lands_on,
    missing_frames,
    step_sizes,
    take_exchanges,
)
from lumbar.lifting.quality.sheet import ERROR, LEFT_OUT, NOTED, PROPOSED, Finding, Legend
from lumbar.lifting.quality.trajectories import (
    LABORATORY_M,
    beyond_laboratory,
    frozen_stretches,
    held_samples,
)

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "gate")

_STATURES_M = (0.6, 2.6)
_CLOUD_M = (0.15, 6.0)
"""Plausible extent of all markers in one frame, where no label is known."""
_FACTORS = (1000.0, 100.0, 10.0, 25.4, 2.54)


def examine(
    points: dict[str, np.ndarray],
    time: np.ndarray,
    rate: float,
    height_m: float | None = None,
    meant: dict[str, str] | None = None,
) -> list[Finding]:
    """Find what in a recording cannot be a body that moves, by marker and time.

    Single trajectories come first (outside any laboratory, frozen), then leaps and exchanged labels, then the whole: sides,
    rigid parts, stature. What one check finds is hidden from the next. Findings are sorted by what they lead to, then by
    time; a valid recording has none.

    Parameters
    ----------
    points : dict of str to ndarray, shape (n_frames, 3)
        Measured markers by the file's labels; metres, z up; NaN where not seen.
    height_m : float, optional
        Stature of the person; without it any from 0.6 to 2.6 m is accepted.
    meant : dict of str to str, optional
        Landmark to label, where labels mean something else than usual.
    """
    if not points:
        return []
    legend = Legend(time, rate, {label: landmark for landmark, label in landmarks(points, meant).items()})
    wrong = _unit(points, legend, height_m)
    if wrong:
        return wrong
    findings, stepping = held_samples(points, legend)
    for check in (beyond_laboratory, frozen_stretches):
        found = check(points, legend)
        findings += found
        points = mask_findings(points, found)
    found, points = _leaps(points, legend)
    findings += found
    for label, stretch, evidence in off_its_part(points, legend.rate):
        findings.append(legend.finding("off its part", (label,), stretch, evidence=evidence))
    noisy = _jitter({label: points[label] for label in points if label not in stepping}, legend)
    findings += _stature(points, legend, height_m) + noisy
    order = (ERROR, PROPOSED, LEFT_OUT, NOTED)
    return sorted(findings, key=lambda finding: (order.index(finding.outcome), finding.first_frame))


def unchecked_properties(
    points: dict[str, np.ndarray], height_m: float | None = None, meant: dict[str, str] | None = None
) -> dict[str, str]:
    """Return what `examine` cannot compare with a body in a recording, with the reason; parameters as there."""
    if not points:
        return {}
    named = {label: landmark for landmark, label in landmarks(points, meant).items()}
    sampled = _sampled(points)
    _, lengths = stature_found(sampled, named)
    sides, depths = rightward(sampled, named)
    found = {}
    if lengths < 2:
        reason = f"the labels name {'one length' if lengths else 'no length'} of a body"
        found["stature"] = reason
        found["unit"] = (
            f"{reason}; all markers of a frame fill {_cloud(sampled):.2g} m, and that is all that is known"
        )
    elif not height_m:
        found["stature"] = "height_m is not given"
    if len(sides) + len(depths) < 3:
        found["left and right"] = "the labels name fewer than three pairs of sides"
    return found


def mask_findings(points: dict[str, np.ndarray], findings: list[Finding]) -> dict[str, np.ndarray]:
    """Return the points with NaN where a finding leaves a marker out or proposes another label for it."""
    result = dict(points)
    for finding in findings:
        if finding.outcome in (LEFT_OUT, PROPOSED):
            for label in finding.markers:
                changed = result[label].copy()
                changed[finding.frames] = np.nan
                result[label] = changed
    return result


def usable_markers(points: dict[str, np.ndarray], findings: list[Finding]) -> dict[str, np.ndarray]:
    """Return the markers that are not left out of all frames, without the frames that are; exchanges are not made."""
    kept = mask_findings(points, [finding for finding in findings if finding.outcome == LEFT_OUT])
    return {label: positions for label, positions in kept.items() if np.isfinite(positions).any()}


def _sampled(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    every = max(1, len(next(iter(points.values()))) // _AT.samples)
    return {label: positions[::every] for label, positions in points.items()}


def _unit(points: dict[str, np.ndarray], legend: Legend, height_m: float | None) -> list[Finding]:
    """An error where the body is far too large or too small for a person."""
    sampled = _sampled(points)
    far = np.concatenate([np.abs(places[np.isfinite(places)]).ravel() for places in sampled.values()])
    stature, count = stature_found(sampled, legend.named)
    if np.median(far) > LABORATORY_M and not 0 < stature < LABORATORY_M:
        return [legend.finding("unit of no laboratory", far=np.median(far))]
    if count >= 2:
        low, high = (height_m / _AT.wrong_unit, height_m * _AT.wrong_unit) if height_m else _STATURES_M
        size, expected = stature, height_m or _AT.person_m
        evidence = f"{count} lengths of the body are those of a person {stature:.3g} m tall" + (
            f"; height_m is {height_m:g}" if height_m else ""
        )
    else:
        low, high = _CLOUD_M
        size, expected = _cloud(sampled), _AT.person_m
        evidence = f"the markers of one frame fill {size:.3g} m"
    if not np.isfinite(size) or low <= size <= high:
        return []
    return [legend.finding("unit", evidence=evidence, cause=_which_unit(size / expected))]


def _cloud(points: dict[str, np.ndarray]) -> float:
    """Median extent of all markers of one frame, metres; NaN of fewer than three markers."""
    stacked = np.stack(list(points.values()), axis=1)
    extents = [_extent(frame) for frame in stacked]
    return float(np.nanmedian(extents)) if np.isfinite(extents).any() else np.nan


def _extent(frame: np.ndarray) -> float:
    seen = frame[np.isfinite(frame).all(axis=1)]
    return float(np.ptp(seen, axis=0).max()) if len(seen) > 2 else np.nan


def _which_unit(factor: float) -> str:
    if not 0 < factor < np.inf:
        return "set markers.scale or markers.unit"
    for candidate in _FACTORS:
        for times in (candidate, 1 / candidate):
            if abs(np.log(factor / times)) < np.log(1.35):
                return f"the unit is wrong by a factor of {times:.4g}: set markers.scale to {1 / times:.4g}, or markers.unit"
    return f"{factor:.2g} times a person's size: set markers.scale, or the subject's height_m"


def _leaps(points: dict[str, np.ndarray], legend: Legend) -> tuple[list[Finding], dict[str, np.ndarray]]:
    """Exchanged labels, leaps and spikes; the points with exchanges undone and leaps left out, for the checks that follow."""
    leaps, spikes = {}, {}
    for label, positions in points.items():
        leaps[label], spikes[label] = find_leaps(positions, legend.rate)
    # Frames between which most markers leap, not counting exchanges.
    missing, _ = missing_frames(points, take_exchanges(leaps)[1], legend)
    if missing:
        _, leaps = missing_frames(points, leaps, legend)
    exchanges, remaining = take_exchanges(leaps)
    n_frames = len(legend.time)
    straight = points
    for exchange in exchanges:
        shorter, _ = exchange.stretches(n_frames)
        straight = _exchanged(straight, (exchange.first, exchange.second), shorter)
    findings = missing + _displaced(straight, remaining, spikes, legend)
    straight = mask_findings(straight, findings)
    sided, mirrored = side_exchanges(_sampled(straight), legend.named)
    whole = [((one, other), evidence) for one, other, evidence in sided]
    reversed_pairs = {frozenset(pair) for pair, _ in whole}
    sides = {frozenset(pair) for pair in side_pairs(points, legend.named)}
    flipped = _flipped(exchanges, reversed_pairs, sides)
    for pair in {*reversed_pairs, *(one.pair for one in flipped)}:
        straight = _exchanged(straight, tuple(pair), [slice(0, n_frames)])
    changing = frozenset().union(*(one.pair for one in exchanges))
    for exchange in exchanges:
        shorter, longer = exchange.stretches(n_frames)
        if exchange in flipped:
            whole = [item for item in whole if frozenset(item[0]) != exchange.pair]
        wrong = longer if exchange in flipped else shorter
        findings += _exchange_findings(points, straight, exchange, wrong, changing, legend)
    findings += [legend.finding("exchanged", pair, evidence=evidence, pair=pair) for pair, evidence in whole]
    if mirrored:
        findings.append(legend.finding("mirrored", evidence=mirrored))
    return findings, straight


def _flipped(
    exchanges: list[Exchange], reversed_pairs: set[frozenset[str]], sides: set[frozenset[str]]
) -> list[Exchange]:
    """Exchanges whose other stretches are the wrong ones: labels that still stand wrongly once the shorter ones are exchanged.

    Left and right of several markers that change places at once, as of both legs, are wrong together.
    """
    flipped = [exchange for exchange in exchanges if exchange.pair in reversed_pairs]
    at_once = {exchange.frames for exchange in flipped if exchange.pair in sides}
    return [
        exchange
        for exchange in exchanges
        if exchange in flipped or (exchange.pair in sides and exchange.frames in at_once)
    ]


def _exchanged(points, pair: tuple[str, str], stretches: list[slice]) -> dict[str, np.ndarray]:
    one, other = points[pair[0]].copy(), points[pair[1]].copy()
    for stretch in stretches:
        one[stretch], other[stretch] = points[pair[1]][stretch], points[pair[0]][stretch]
    return {**points, pair[0]: one, pair[1]: other}


def _exchange_findings(
    points, straight, exchange: Exchange, stretches: list[slice], changing: frozenset[str], legend: Legend
) -> list[Finding]:
    """One finding per stretch, with the lengths to a third marker, which changes no place, as they are and as they would be."""
    pair = (exchange.first, exchange.second)
    others = {one: points for one, points in _sampled(straight).items() if one not in changing - {pair[0]}}
    mate = steadiest_mate(others, exchange.first)
    findings = []
    for stretch in stretches:
        evidence = f"each leaps {exchange.distance * 1e3:.0f} mm to where the other was"
        if mate:
            usual = length(straight, exchange.first, mate, slice(None)) * 1e3
            there = length(points, exchange.first, mate, stretch) * 1e3
            mended = length(points, exchange.second, mate, stretch) * 1e3
            evidence += f"; {exchange.first} is {usual:.0f} mm from {mate}, here {there:.0f} mm"
            evidence += f", with labels exchanged {mended:.0f} mm"
        findings.append(legend.finding("exchanged here", pair, stretch, evidence=evidence))
    return findings


def _displaced(
    points, leaps: dict[str, list[Leap]], spikes: dict[str, list[slice]], legend: Legend
) -> list[Finding]:
    """Stretches after leaps that no exchange explains, and spikes; of a marker with many of them one finding."""
    findings = []
    most = max(_AT.restless_leaps, _AT.restless_share * len(legend.time))
    for label, positions in points.items():
        count = len(leaps[label]) + len(spikes[label])
        if count > most:
            findings.append(legend.finding("restless", (label,), count=count))
            continue
        stretches, untold = displacements(points, label, leaps, legend)
        for stretch in stretches:
            leap = stretch.leap
            other = lands_on(leap, label, points)
            words = {
                "size": leap.size * 1e3,
                "at": legend.time[leap.first],
                "seen": stretch.seen,
                "other": other,
            }
            kind = "jump onto another" if other else "jump"
            findings.append(legend.finding(kind, (label,), stretch.frames, **words))
        for leap in untold:
            frames, words = slice(leap.last, leap.first + 1), {"size": leap.size * 1e3}
            findings.append(
                legend.finding("untold jump", (label,), frames, **words, at=legend.time[leap.first])
            )
        for spike in spikes[label]:
            ends = positions[[max(0, spike.start - 1), min(len(positions) - 1, spike.stop)]]
            off = np.linalg.norm(positions[spike] - ends.mean(axis=0), axis=1)
            findings.append(legend.finding("spike", (label,), spike, off=float(np.nanmax(off)) * 1e3))
    return findings


def _stature(points: dict[str, np.ndarray], legend: Legend, height_m: float | None) -> list[Finding]:
    stature, count = stature_found(_sampled(points), legend.named)
    if not height_m or count < 2 or 1 / _AT.other_stature < stature / height_m < _AT.other_stature:
        return []
    return [legend.finding("stature", count=count, stature=stature, height_m=height_m)]


def _jitter(points: dict[str, np.ndarray], legend: Legend) -> list[Finding]:
    """Markers with noise; where most have it, one finding of all."""
    noisy = {}
    for label, positions in points.items():
        size = step_sizes(positions)
        usual = float(np.nanmedian(size)) if np.isfinite(size).any() else 0.0
        if usual > max(_AT.jitter_m, _AT.jerk_m_s3 / legend.rate**3):
            noisy[label] = _AT.rms_of_steps * usual * 1e3
    if len(noisy) > _AT.fewest_together and 2 * len(noisy) > len(points):
        words = {"least": min(noisy.values()), "most": max(noisy.values()), "count": len(noisy)}
        return [legend.finding("jitter of most", of=len(points), **words)]
    return [legend.finding("jitter", (label,), noise=noise) for label, noise in noisy.items()]
