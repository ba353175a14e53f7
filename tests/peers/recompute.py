#!/usr/bin/env python3
"""Computes the numbers of a run again from its raw impedance, without any code of rigd.

Usage: recompute.py RUN.json   (the output of `rigd run … --json`)

Reads `readings.csv` of the run, fits the Butterworth–Van Dyke circuit with dielectric loss to every
accepted sweep by scipy's least squares from a start of its own, and compares resonances, shifts, the
table, the sensitivity and the classification with what rigd says. Exits 1 when anything differs by
more than it may: a resonance by more than a tenth of its stated standard deviation.
"""

import csv
import itertools
import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

TENTH_OF_SIGMA = 0.1


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def fit(frequency_hz, impedance_ohm, cycles):
    """The series resonance of the readings, Hz, weighted by what each reading integrated."""

    def model(parameters, u_of):
        log_f, log_q, log_c0, log_m, loss = parameters
        f, q, c0, m = np.exp([log_f, log_q, log_c0, log_m])
        u = u_of / f
        return 1j * 2 * np.pi * u_of * c0 * ((1 - 1j * loss) + m / (1 - u * u + 1j * u / q))

    weight = np.sqrt(cycles / cycles.mean())

    def residuals(parameters):
        r = weight * (impedance_ohm * model(parameters, frequency_hz) - 1)
        return np.concatenate([r.real, r.imag])

    admittance = 1 / impedance_ohm
    c0 = np.median(admittance.imag / (2 * np.pi * frequency_hz))
    best = None
    starts = itertools.product(frequency_hz[np.argsort(-admittance.real)[:3]], (15, 50))
    for f, q in starts:
        start = [np.log(f), np.log(q), np.log(abs(c0)), np.log(0.05), 0.01]
        found = least_squares(residuals, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if best is None or found.cost < best.cost:
            best = found
    return float(np.exp(best.x[0]))


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
        if row["is_used"] == "true" and row["flag"] != "overload":
            readings[row["sweep"]].append(row)

    failures = []
    mine = {}
    worst = 0.0
    for sweep in table(data / "sweeps.csv"):
        if sweep["verdict"] != "accepted":
            continue
        rows = readings[sweep["sweep"]]
        column = lambda name: np.array([float(row[name]) for row in rows])
        frequency = column("frequency_hz")
        impedance = column("resistance_ohm") + 1j * column("reactance_ohm")
        mine[sweep["sweep"]] = fit(frequency, impedance, column("integration_s") * frequency)
        theirs, sigma = float(sweep["resonance_hz"]), float(sweep["sigma_hz"])
        difference = abs(mine[sweep["sweep"]] - theirs) / sigma
        worst = max(worst, difference)
        if difference > TENTH_OF_SIGMA:
            failures.append(f"sweep {sweep['sweep']}: {theirs} Hz, here {mine[sweep['sweep']]}")
    print(f"{len(mine)} sweeps, the largest difference is {worst:.4f} standard deviations")

    touches = table(data / "touches.csv")
    shifts = defaultdict(list)
    blind = []
    for touch in touches:
        shift = mine[touch["sweep"]] - mine[touch["no_load_sweep"]]
        if abs(shift - float(touch["shift_hz"])) > 0.2 * float(touch["shift_sigma_hz"]):
            failures.append(f"{touch['step']}: shift {touch['shift_hz']} Hz, here {shift}")
        if touch["phase"] == "main":
            key = (touch["sample"], touch["direction"], float(touch["angle_deg"]))
            shifts[key].append(shift)
        else:
            blind.append((touch["sample"], shift))

    stated = {(s["sample"], s["direction"], s["angle_deg"]): s for s in result["shifts"]}
    for key, values in shifts.items():
        row = stated.get(key)
        if row is None or abs(row["shift_hz"] - np.mean(values)) > 0.2 * row["sigma_hz"]:
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
