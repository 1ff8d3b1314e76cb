"""Checks of a marker recording before it is used: its points must be able to be a moving body."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from lumbar.base.yaml_file import shipped_names
from lumbar.lifting.quality import body, displacement
from lumbar.lifting.quality import implausible_motion as motion
from lumbar.lifting.quality.findings import ERROR, LEFT_OUT, NOTED, PROPOSED, Legend, MarkerFinding
from lumbar.lifting.quality.marker_sets import landmarks
from lumbar.records.marker_axes import find_up

_AT = shipped_names(Path(__file__).with_name("thresholds.yaml"), "gate")

_STATURES_M = (0.6, 2.6)
_EXTENTS_M = (0.15, 6.0)
"""Plausible extent of all markers in one frame, used if no label is known."""
_FACTORS = (1000.0, 100.0, 10.0, 25.4, 2.54)


def examine(
    points: dict[str, np.ndarray],
    time: np.ndarray,
    rate: float,
    height_m: float | None = None,
    meant: dict[str, str] | None = None,
) -> list[MarkerFinding]:
    """Find the markers and frames of a recording that cannot be a moving body.

    Single trajectories are checked first (outside any laboratory, frozen), then leaps and exchanged labels, then the whole body
    (sides, rigid parts, stature). Frames with a finding are masked in later checks. Findings are sorted by outcome, then by
    time; a valid recording has none.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Measured markers by the file's labels; metres, z up; NaN if not seen.
    time : numpy.ndarray, shape (n_frames,)
        Time in s.
    rate : float
        Frames per second.
    height_m : float, optional
        Stature of the subject; without it, any stature from 0.6 to 2.6 m is accepted.
    meant : dict of str to str, optional
        Label by landmark, for labels with an unusual meaning.
    """
    if not points:
        return []
    legend = Legend(time, rate, {label: landmark for landmark, label in landmarks(points, meant).items()})
    wrong_unit = _unit(points, legend, height_m)
    if wrong_unit:
        return wrong_unit
    findings, stepping = motion.find_repeated_samples(points, legend)
    for check in (motion.find_positions_outside, motion.find_frozen_intervals):
        new = check(points, legend)
        findings += new
        points = mask_findings(points, new)
    new, points = _find_leaps_and_exchanges(points, legend)
    findings += [*new, *displacement.find_rigid_violations(points, legend)]
    stature, count = body.estimate_stature(_sampled(points), legend.named)
    if height_m and count >= 2 and not 1 / _AT.other_stature < stature / height_m < _AT.other_stature:
        evidence = f"{count} lengths of the body are those of a person {stature:.2f} m tall; height_m is {height_m:g}"
        cause = "another person's recording, or a wrong height_m"
        findings.append(legend.finding("stature", NOTED, evidence, cause))
    findings += _find_jitter({label: points[label] for label in points if label not in stepping}, legend)
    order = (ERROR, PROPOSED, LEFT_OUT, NOTED)
    return sorted(findings, key=lambda finding: (order.index(finding.outcome), finding.first_frame))


def unchecked_properties(
    points: dict[str, np.ndarray], height_m: float | None = None, meant: dict[str, str] | None = None
) -> dict[str, str]:
    """Return the properties that `examine` cannot check, with the reason.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    height_m : float, optional
        Stature of the subject.
    meant : dict of str to str, optional
        Label of the file by landmark, if the configuration names it.
    """
    if not points:
        return {}
    named = {label: landmark for landmark, label in landmarks(points, meant).items()}
    sampled = _sampled(points)
    _, lengths = body.estimate_stature(sampled, named)
    sides, depths = body.rightward(sampled, named)
    reasons = {}
    if lengths < 2:
        reasons["stature"] = f"the labels name {'one length' if lengths else 'no length'} of a body"
        reasons["unit"] = (
            f"{reasons['stature']}; only the extent of all markers of a frame is known, {_median_extent(sampled):.2g} m"
        )
    elif not height_m:
        reasons["stature"] = "height_m is not given"
    if len(sides) + len(depths) < 3:
        is_level = find_up({landmark: sampled[label] for label, landmark in named.items()}) is not None
        reasons["left and right"] = (
            "the labels name fewer than three pairs of sides"
            if is_level
            else "no known label shows which axis is up"
        )
    return reasons


def mask_findings(points: dict[str, np.ndarray], findings: list[MarkerFinding]) -> dict[str, np.ndarray]:
    """Return the points with NaN in frames in which a finding leaves out a marker.

    Parameters
    ----------
    points : dict of str to numpy.ndarray, shape (n_frames, 3)
        Markers by label in m.
    findings : list of MarkerFinding
        Findings in this recording.
    """
    result = dict(points)
    for finding in findings:
        if finding.outcome == LEFT_OUT:
            for label in finding.markers:
                changed = result[label].copy()
                changed[finding.frames] = np.nan
                result[label] = changed
    return result


def _sampled(points: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    every = max(1, len(next(iter(points.values()))) // _AT.samples)
    return {label: positions[::every] for label, positions in points.items()}


def _unit(points: dict[str, np.ndarray], legend: Legend, height_m: float | None) -> list[MarkerFinding]:
    """Return an error if the body is far too large or too small for a person."""
    sampled = _sampled(points)
    far = np.median(
        np.concatenate([np.abs(places[np.isfinite(places)]).ravel() for places in sampled.values()])
    )
    stature, count = body.estimate_stature(sampled, legend.named)
    if far > motion.LABORATORY_M and not 0 < stature < motion.LABORATORY_M:
        cause = "no laboratory is so large: set markers.scale or markers.unit"
        return [legend.finding("unit", ERROR, f"coordinates of {far:.3g} m", cause)]
    if count >= 2:
        low, high = (height_m / _AT.wrong_unit, height_m * _AT.wrong_unit) if height_m else _STATURES_M
        size, expected = stature, height_m or _AT.person_m
        evidence = f"{count} lengths of the body are those of a person {stature:.3g} m tall" + (
            f"; height_m is {height_m:g}" if height_m else ""
        )
    else:
        low, high = _EXTENTS_M
        size, expected = _median_extent(sampled), _AT.person_m
        evidence = f"the markers of one frame fill {size:.3g} m"
    if not np.isfinite(size) or low <= size <= high:
        return []
    factor = size / expected
    candidates = (times for candidate in _FACTORS for times in (candidate, 1 / candidate))
    if not 0 < factor < np.inf:
        remedy = "set markers.scale or markers.unit"
    elif times := next((times for times in candidates if abs(np.log(factor / times)) < np.log(1.35)), None):
        remedy = f"the unit is wrong by a factor of {times:.4g}: set markers.scale to {1 / times:.4g}, or markers.unit"
    else:
        remedy = f"{factor:.2g} times a person's size: set markers.scale, or the subject's height_m"
    return [legend.finding("unit", ERROR, evidence, remedy)]


def _median_extent(points: dict[str, np.ndarray]) -> float:
    """Return the median extent of all markers of one frame, metres; NaN for fewer than three markers."""
    stacked = np.stack(list(points.values()), axis=1)
    visible = [frame[np.isfinite(frame).all(axis=1)] for frame in stacked]
    extents = [float(np.ptp(frame, axis=0).max()) for frame in visible if len(frame) > 2]
    return float(np.median(extents)) if extents else np.nan


def _find_leaps_and_exchanges(
    points: dict[str, np.ndarray], legend: Legend
) -> tuple[list[MarkerFinding], dict[str, np.ndarray]]:
    """Find exchanged labels, leaps and spikes; return also the points with exchanges undone and leaps left out."""
    leaps, spikes = {}, {}
    for label, positions in points.items():
        leaps[label], spikes[label] = motion.find_leaps(positions, legend.rate)
    # Frames between which most markers leap, not counting exchanges.
    missing, _ = motion.missing_frames(points, motion.take_exchanges(leaps)[1], legend)
    if missing:
        _, leaps = motion.missing_frames(points, leaps, legend)
    exchanges, remaining = motion.take_exchanges(leaps)
    n_frames = len(legend.time)
    straight = points
    for exchange in exchanges:
        shorter, _ = exchange.intervals(n_frames)
        straight = body.exchange_labels(straight, (exchange.first, exchange.second), shorter)
    findings = missing + _find_displacements(straight, remaining, spikes, legend)
    straight = mask_findings(straight, findings)
    sided, mirrored = body.side_exchanges(_sampled(straight), legend.named)
    reversed_pairs = {frozenset(pair.labels) for pair in sided}
    sides = {frozenset(pair) for pair in body.side_pairs(points, legend.named)}
    # Exchanges whose other intervals are wrong: labels that are still wrong after the shorter ones are exchanged. Left and right
    # of several markers that change places simultaneously, such as both legs, are wrong together.
    still_wrong = [exchange for exchange in exchanges if exchange.pair in reversed_pairs]
    simultaneous = {exchange.frames for exchange in still_wrong if exchange.pair in sides}
    flipped = [
        exchange
        for exchange in exchanges
        if exchange in still_wrong or (exchange.pair in sides and exchange.frames in simultaneous)
    ]
    for pair in {*reversed_pairs, *(one.pair for one in flipped)}:
        straight = body.exchange_labels(straight, tuple(pair))
    changing = frozenset().union(*(one.pair for one in exchanges))
    compared = body.rightward(_sampled(straight), legend.named)[0] if exchanges else {}
    for exchange in exchanges:
        shorter, longer = exchange.intervals(n_frames)
        if exchange in flipped:
            sided = [pair for pair in sided if frozenset(pair.labels) != exchange.pair]
        wrong = longer if exchange in flipped else shorter
        # Labels that change back soon were wrong in between. Otherwise only the sides of the body show the wrong part.
        n_short = sum(part.stop - part.start for part in shorter)
        is_back = len(exchange.frames) % 2 == 0 and n_short < n_frames / 3
        items = _exchange_findings(points, straight, exchange, wrong, changing, legend)
        if not is_back and exchange.pair not in map(frozenset, compared):
            remark = ", unless the other part is the wrong one: nothing is left out"
            items = [replace(item, outcome=PROPOSED, cause=item.cause + remark) for item in items]
        findings += items
    for pair in sided:
        one, other = pair.labels
        cause = f"their labels may be exchanged: if so, exchange {one} and {other} in markers.aliases; nothing is left out"
        findings.append(legend.finding("exchanged", PROPOSED, pair.evidence, cause, pair.labels))
    if mirrored:
        cause = "the labels of both sides are exchanged, or an axis of the file is mirrored"
        findings.append(legend.finding("mirrored", ERROR, mirrored, cause))
    return findings, straight


def _exchange_findings(
    points,
    straight,
    exchange: motion.Exchange,
    intervals: list[slice],
    changing: frozenset[str],
    legend: Legend,
) -> list[MarkerFinding]:
    """Return a finding per interval, with the distances to a third, unchanged marker under both labellings."""
    pair = (exchange.first, exchange.second)
    others = {one: points for one, points in _sampled(straight).items() if one not in changing - {pair[0]}}
    mate = displacement.steadiest_mate(others, exchange.first)
    cause = "their labels are exchanged in these frames: label both again in the capture software"
    findings = []
    for frames in intervals:
        evidence = f"each leaps {exchange.distance * 1e3:.0f} mm to the place of the other"
        if mate:
            between = (
                straight[exchange.first] - straight[mate],
                *(points[label][frames] - points[mate][frames] for label in pair),
            )
            typical, here, swapped = (_median_length_mm(vectors) for vectors in between)
            evidence += f"; {exchange.first} is {typical:.0f} mm from {mate}, here {here:.0f} mm"
            evidence += f", with labels exchanged {swapped:.0f} mm"
        findings.append(legend.finding("exchanged", LEFT_OUT, evidence, cause, pair, frames))
    return findings


def _median_length_mm(vectors: np.ndarray) -> float:
    length = np.linalg.norm(vectors[np.isfinite(vectors).all(axis=1)], axis=1)
    return 1e3 * float(np.median(length)) if length.size else np.nan


def _find_displacements(
    points, leaps: dict[str, list[motion.Leap]], spikes: dict[str, list[slice]], legend: Legend
) -> list[MarkerFinding]:
    """Return findings for spikes and for intervals after unexplained leaps; a single finding for a marker with many of them."""
    findings = []
    most = max(_AT.restless_leaps, _AT.restless_share * len(legend.time))
    for label, positions in points.items():
        count = len(leaps[label]) + len(spikes[label])
        if count > most:
            evidence = f"{count} leaps of more than 20 mm from one frame to the next"
            cause = "a reflection, or two markers under one label"
            findings.append(legend.finding("restless", NOTED, evidence, cause, (label,)))
            continue
        displaced, undecided = displacement.displacements(points, label, leaps, legend)
        for one in displaced:
            other = motion.marker_at_landing(one.leap, label, points)
            cause = "another reflection under this label, or a marker that came off"
            if other:
                cause = f"it is at the place of {other}: two labels were exchanged"
            evidence = f"{_format_leap(one.leap, legend)}, {one.evidence}"
            outcome = LEFT_OUT if one.is_certain else PROPOSED
            findings.append(legend.finding("jump", outcome, evidence, cause, (label,), one.frames))
        for leap in undecided:
            evidence = f"{_format_leap(leap, legend)}; its distances to other markers do not show if it is wrong before or after"
            cause = "check it in the capture software: nothing is left out"
            frames = slice(leap.last, leap.first + 1)
            findings.append(legend.finding("jump", NOTED, evidence, cause, (label,), frames))
        for spike in spikes[label]:
            ends = positions[[max(0, spike.start - 1), min(len(positions) - 1, spike.stop)]]
            off = np.linalg.norm(positions[spike] - ends.mean(axis=0), axis=1)
            evidence = f"deviates from its path by up to {np.nanmax(off) * 1e3:.0f} mm and returns"
            cause = "a reflection mistaken for the marker"
            findings.append(legend.finding("spike", LEFT_OUT, evidence, cause, (label,), spike))
    return findings


def _format_leap(leap: motion.Leap, legend: Legend) -> str:
    return f"leaps {leap.size * 1e3:.0f} mm at {legend.time[leap.first]:.2f} s"


def _find_jitter(points: dict[str, np.ndarray], legend: Legend) -> list[MarkerFinding]:
    """Return a finding per noisy marker, or a single finding if most markers are noisy."""
    noise_mm = {}
    for label, positions in points.items():
        size = motion.step_sizes(positions)
        typical = float(np.nanmedian(size)) if np.isfinite(size).any() else 0.0
        if typical > max(_AT.jitter_m, _AT.jerk_m_s3 / legend.rate**3):
            noise_mm[label] = _AT.rms_of_steps * typical * 1e3
    measure = "mm (root mean square distance from a smooth path)"
    if len(noise_mm) > _AT.fewest_together and 2 * len(noise_mm) > len(points):
        least, largest = min(noise_mm.values()), max(noise_mm.values())
        evidence = f"noise of about {least:.1f} to {largest:.1f} {measure} in {len(noise_mm)} of {len(points)} markers"
        cause = "badly calibrated cameras, or rounded or resampled coordinates"
        return [legend.finding("jitter", NOTED, evidence, cause)]
    cause = "few cameras see it, or they are badly calibrated"
    return [
        legend.finding("jitter", NOTED, f"noise of about {noise:.1f} {measure}", cause, (label,))
        for label, noise in noise_mm.items()
    ]
