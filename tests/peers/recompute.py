#!/usr/bin/env python3
"""Computes the numbers of a run again from its raw impedance, without any code of rigd.

Usage: recompute.py RUN.json   (the output of `rigd run … --json`)

Reads `readings.csv` of the run, fits the Butterworth–Van Dyke circuit with dielectric loss to every
accepted sweep by scipy's least squares from starts of its own, and compares resonances, shifts, the
table, the sensitivity and the classification with what rigd says. Exits 1 when anything differs by
more than it may: a resonance or a shift by more than half of its stated standard deviation. Which
reading counts for how much depends a little on the noise, which rigd learns as it goes, and this
program does not.
"""

import csv
import itertools
import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

SIGMAS = 0.5


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


# Standard deviation of the noise of ten cycles, beside which a reading has settled or not, and by how
# much more what is left of the motion is feared.
NOISE = 0.005
MARGIN = 1.5


def left_over(parameters, frequency_hz, started_s, settle_s, integration_s):
    """The variance of each part of the relative error that the motion left over from earlier points
    adds to each reading, when the drive between two points may have had any phase."""
    f, q, _, m = np.exp(parameters[:4])
    response = 1 / (1 - (frequency_hz / f) ** 2 + 1j * frequency_hz / f / q)
    s = 2 * np.pi * f * (-0.5 / q + 1j * np.sqrt(1 - 0.25 / q**2))
    variance = np.zeros(len(frequency_hz))
    # The drive before the first point may have been at the resonance.
    amplitude, before, end_s = 0.0, q, started_s[0]
    for i, (hz, begun_s) in enumerate(zip(frequency_hz, started_s)):
        is_new = i == 0 or hz != frequency_hz[i - 1]
        amplitude *= np.exp(2 * s.real * max(begun_s - end_s, 0.0))
        if is_new:
            amplitude += abs(response[i]) ** 2 + before**2
            before = abs(response[i])
        is_same_stay = i > 0 and not is_new and begun_s == started_s[i - 1]
        wait_s = begun_s + settle_s[i] - end_s if is_same_stay else settle_s[i]
        duration_s = integration_s[i]
        heard = sum(
            abs(z * (np.exp(z * duration_s) - 1) / ((z - 2j * np.pi * hz) * duration_s)) ** 2
            for z in (s, s.conjugate())
        )
        total = 2 * np.pi * hz * (1 - 1j * parameters[4] + m * response[i])
        now = amplitude * np.exp(2 * s.real * wait_s)
        # Readings of one stay hear the same motion: only what has died away in between is new.
        new = 1 if is_new else max(1 - now / read, 1e-12)
        read = now
        part = 0.5 * MARGIN * now * heard / new
        variance[i] = part * m**2 / abs(total) ** 2
        amplitude *= np.exp(2 * s.real * (wait_s + duration_s))
        end_s = begun_s + settle_s[i] + duration_s
    return variance


def fit(frequency_hz, impedance_ohm, *times, stated):
    """The series resonance of the readings, Hz. Each counts for as much as it was integrated for, and
    for as much as it has settled if the circuit is nearly the stated one."""
    variance = 10 / (times[-1] * frequency_hz)
    variance += left_over(stated, frequency_hz, *times) / NOISE**2
    return float(np.exp(fit_weighted(frequency_hz, impedance_ohm, variance)[0]))


def fit_weighted(frequency_hz, impedance_ohm, variance):
    """The most likely circuit, for readings of these relative variances."""

    def model(parameters, u_of):
        log_f, log_q, log_c0, log_m, loss = parameters
        f, q, c0, m = np.exp([log_f, log_q, log_c0, log_m])
        u = u_of / f
        return 1j * 2 * np.pi * u_of * c0 * ((1 - 1j * loss) + m / (1 - u * u + 1j * u / q))

    weight = 1 / np.sqrt(variance / variance.min())

    def residuals(parameters):
        # Nearly ln x, and bounded where a reading is nowhere near.
        x = impedance_ohm * model(parameters, frequency_hz)
        r = weight * 2 * (x - 1) / (x + 1)
        return np.concatenate([r.real, r.imag])

    admittance = 1 / impedance_ohm
    c0 = np.median(admittance.imag / (2 * np.pi * frequency_hz))
    best = None
    starts = itertools.product(frequency_hz[np.argsort(-admittance.real)[:3]], (15, 50))
    starts = [[np.log(f), np.log(q), np.log(abs(c0)), np.log(0.05), 0.01] for f, q in starts]
    for start in starts:
        found = least_squares(residuals, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if best is None or found.cost < best.cost:
            best = found
    return best.x


def k_means(values, k):
    """The optimum of k-means in one dimension, by dynamic programming over sorted values."""
    order = np.argsort(values)
    x = np.asarray(values)[order]
    n = len(x)
    sums, squares = np.concatenate([[0], np.cumsum(x)]), np.concatenate([[0], np.cumsum(x * x)])

    def cost(i, j):
        return squares[j] - squares[i] - (sums[j] - sums[i]) ** 2 / (j - i)

    best = np.full((k + 1, n + 1), np.inf)
    cut = np.zeros((k + 1, n + 1), dtype=int)
    best[0, 0] = 0
    for c in range(1, k + 1):
        for j in range(c, n + 1):
            for i in range(c - 1, j):
                total = best[c - 1, i] + cost(i, j)
                if total < best[c, j]:
                    best[c, j], cut[c, j] = total, i
    labels = np.zeros(n, dtype=int)
    j = n
    for c in range(k, 0, -1):
        i = cut[c, j]
        labels[order[i:j]] = c - 1
        j = i
    return labels


def main():
    result = json.loads(Path(sys.argv[1]).read_text())
    data = Path(result["data"])
    readings = defaultdict(list)
    for row in table(data / "readings.csv"):
        if row["flag"] == "normal":
            readings[row["sweep"]].append(row)

    failures = []
    mine = {}
    worst = 0.0
    for sweep in table(data / "sweeps.csv"):
        if sweep["outcome"] != "accepted":
            continue
        rows = readings[sweep["sweep"]]
        column = lambda name: np.array([float(row[name]) for row in rows])
        frequency = column("frequency_hz")
        impedance = column("resistance_ohm") + 1j * column("reactance_ohm")
        times = [column(name) for name in ("started_s", "settle_s", "integration_s")]
        names = ("resonance_hz", "quality_factor", "static_capacitance_f", "capacitance_ratio")
        stated = [*np.log([float(sweep[name]) for name in names]), float(sweep["loss_tangent"])]
        mine[sweep["sweep"]] = fit(frequency, impedance, *times, stated=stated)
        theirs, sigma = float(sweep["resonance_hz"]), float(sweep["sigma_hz"])
        difference = abs(mine[sweep["sweep"]] - theirs) / sigma
        worst = max(worst, difference)
        if difference > SIGMAS:
            failures.append(f"sweep {sweep['sweep']}: {theirs} Hz, here {mine[sweep['sweep']]}")
    print(f"{len(mine)} sweeps, the largest difference is {worst:.4f} standard deviations")

    touches = [touch for touch in table(data / "touches.csv") if touch["status"] == "measured"]
    shifts = defaultdict(list)
    blind = []
    for touch in touches:
        shift = mine[touch["sweep"]] - mine[touch["no_load_sweep"]]
        if abs(shift - float(touch["shift_hz"])) > SIGMAS * float(touch["shift_sigma_hz"]):
            failures.append(f"{touch['step']}: shift {touch['shift_hz']} Hz, here {shift}")
        if touch["phase"] == "main":
            key = (touch["sample"], touch["direction"], float(touch["angle_deg"]))
            shifts[key].append(shift)
        else:
            blind.append((touch["sample"], shift))

    stated = {(s["sample"], s["direction"], s["angle_deg"]): s for s in result["shifts"]}
    for key, values in shifts.items():
        row = stated.get(key)
        if row is None or abs(row["shift_hz"] - np.mean(values)) > SIGMAS * row["sigma_hz"]:
            failures.append(f"{key}: table {row}, here {np.mean(values)}")
    print(f"{len(shifts)} rows of the table of shifts")

    if blind and result.get("classification"):
        names = sorted({name for name, _ in blind} | {key[0] for key in shifts})
        clusters = k_means([shift for _, shift in blind], len(names))
        correct = max(
            sum(names[order[c]] == name for (name, _), c in zip(blind, clusters))
            for order in itertools.permutations(range(len(names)))
        )
        theirs = result["classification"]
        print(f"{correct} of {len(blind)} blind touches in the class of their sample")
        if (correct, len(blind)) != (theirs["correct"], theirs["trials"]):
            failures.append(f"classification {theirs}, here {correct} of {len(blind)}")

    for failure in failures:
        print("DIFFERS", failure)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
