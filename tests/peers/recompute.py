#!/usr/bin/env python3
"""Computes the numbers of a run again from its raw impedance, without any code of rigd.

Usage: recompute.py RUN.json   (the output of `rigd run … --json`)

Reads `readings.csv` of the run, fits the Butterworth–Van Dyke circuit with dielectric loss and the free
decay after each change of frequency to every accepted sweep by scipy's least squares, and compares resonances, shifts, the
table, the sensitivity and the classification with what rigd says. Exits 1 when anything differs by
more than it may: a resonance or a shift by more than half of its stated standard deviation, and the standard deviation of a
row of the table by more than 1 % from that of the touches with what they share of their references. The standard
deviations of the circuit lie within limits of those found here. Which
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

import references

SIGMAS, SIGMA_REL = 0.5, 0.01
# The column with the standard deviation of each value of the circuit, and the least and the largest part of what is found here
# that it may be. That of the resonance has what a second mode, a drift and the survey leave open as well.
CIRCUIT_SIGMAS = {
    "resonance_hz": ("sigma_hz", 0.9, 2.5),
    "quality_factor": ("quality_factor_sigma", 0.9, 1.15),
    "static_capacitance_f": ("static_capacitance_sigma_f", 0.9, 1.15),
    "capacitance_ratio": ("capacitance_ratio_sigma", 0.9, 1.15),
}


def table(path):
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


# Standard deviation of the noise of ten cycles, and of the time between two readings of a stay, s.
NOISE = 0.005
GAP_SIGMA_S = 0.58e-3
# The gap between two readings where none has been seen, s.
GAP_S = 1e-3
# The part of the square of a free decay that each part of its amplitude may have, its phase being random.
AMPLITUDE_SHARE = 0.75
# What is known beforehand of ln Q, C0, C1 and C0 tan δ, the capacitances in units of the median of the readings.
MEAN = np.array([np.log(30), 1.0, 0.0, 0.0])
SPREAD = np.array([1.0, 1.0, 0.15, 0.03])


def stays_of(frequency_hz, begin_s, integration_s, first_gap_s):
    """The readings of each stay at one frequency, and for each reading the time since the first of its
    stay. A reading that would end after the next has begun was reported late by the analyzer, and the
    first gap of every stay is longer than recorded by what the survey found."""
    stays, since_s, start_s = [], [], np.zeros(len(frequency_hz))
    for i, hz in enumerate(frequency_hz):
        after_s = begin_s[i] - begin_s[i - 1] if i else 0.0
        if i == 0 or hz != frequency_hz[i - 1]:
            # The first readings of both stays are wrong by the same time.
            has_gap = bool(stays) and len(stays[-1]) > 1
            since_s.append((start_s[i - 1] - first_gap_s * has_gap if i else 0.0) + after_s)
            stays.append([i])
            continue
        stay = stays[-1]
        start_s[i] = start_s[i - 1] + after_s
        end_s = start_s[i - 1] + integration_s[i - 1]
        if start_s[i] < end_s:
            gaps = [start_s[k + 1] - start_s[k] - integration_s[k] for k in stay[:-1]]
            gaps = [GAP_S] + [gap for gap in gaps if gap > 0]
            late_s = end_s + sum(gaps) / len(gaps) - start_s[i]
            if len(stay) == 1:
                start_s[i] += late_s
            else:
                start_s[i - 1] -= late_s
        if len(stay) == 1:
            start_s[i] += first_gap_s
        stay.append(i)
    return stays, np.array(since_s), start_s


def decay(rate, start_s, integration_s):
    """The mean of exp(rate t) over a reading."""
    x = rate * integration_s
    return np.exp(rate * start_s) * (np.exp(x) - 1) / x


def fit(frequency_hz, impedance_ohm, started_s, settle_s, integration_s, first_gap_s, stated):
    """The series resonance of readings that still ring, Hz, and the relative standard deviations of it, Q, C0 and
    C1/C0 for the noise of this script: the circuit, the amplitude of the free decay of each stay and the error
    of the time of each reading are fitted at once."""
    stays, since_s, start_s = stays_of(
        frequency_hz, started_s + settle_s, integration_s, first_gap_s)
    firsts = np.array([stay[0] for stay in stays])
    stay_of = np.concatenate([[n] * len(stay) for n, stay in enumerate(stays)])
    begins = np.isin(np.arange(len(frequency_hz)), firsts)
    # The first gap of a stay varies by as much as a survey found it to be wrong.
    is_second = np.isin(np.arange(len(frequency_hz)), firsts + 1)
    gap_sigma_s = np.where(is_second, np.hypot(GAP_SIGMA_S, first_gap_s), GAP_SIGMA_S)
    omega = 2 * np.pi * frequency_hz
    unit = np.sort(1 / (omega * abs(impedance_ohm)))[len(omega) // 2]
    z = impedance_ohm * unit
    weight = 1 / np.sqrt(NOISE**2 * 10 / (integration_s * frequency_hz))

    def circuit(x):
        f, q = np.exp(x[:2])
        response = 1 / (1 - (frequency_hz / f) ** 2 + 1j * frequency_hz / f / q)
        s = 2 * np.pi * f * (-0.5 / q + 1j * np.sqrt(1 - 0.25 / q**2))
        steady = 1j * omega * (x[2] - 1j * x[4]) + x[3] * 1j * omega * response
        return f, q, s, response, steady

    def amplitudes(x):
        """The root mean square of the amplitude of the free decay of each stay."""
        f, q, s, response, _ = circuit(x)
        square, forced, out = 0.0, q**2, []
        for first, since in zip(firsts, since_s):
            now = abs(response[first]) ** 2
            square = now + forced + square * np.exp(2 * s.real * since)
            forced = now
            out.append(np.sqrt(square) * abs(x[3]) * 2 * np.pi * f)
        return np.array(out)

    def late(steps):
        """The error of the time of each reading: the steps add up along a stay."""
        total = np.cumsum(np.where(begins, 0.0, steps))
        return total - total[firsts][stay_of]

    def residuals(x, rms, size):
        _, _, s, _, steady = circuit(x)
        n = len(stays)
        a = (x[5 : 5 + n] + 1j * x[5 + n : 5 + 2 * n]) * rms
        steps = x[5 + 2 * n :] * gap_sigma_s
        times = start_s + late(steps)
        model = steady + a[stay_of] * decay(s - 1j * omega, times, integration_s)
        # What turns against the drive is as large, and has any phase.
        counter = decay(s.conjugate() - 1j * omega, times, integration_s)
        variance = weight**-2 + 0.5 * (size[stay_of] * abs(counter) / abs(model)) ** 2
        r = 2 * (z * model - 1) / (z * model + 1) / np.sqrt(variance)
        amplitude = x[5 : 5 + 2 * n] / np.sqrt(AMPLITUDE_SHARE)
        known = (x[1:5] - MEAN) / SPREAD
        return np.concatenate([r.real, r.imag, amplitude, x[5 + 2 * n :][~begins], known])

    f, q, c0, m, loss = stated
    x = np.array([f + 0.03 / np.exp(q), q + 0.1, np.exp(c0) / unit, np.exp(c0 + m) / unit, 0.0])
    x[4] = loss * x[2]
    n = len(stays)
    _, _, s, _, steady = circuit(x)
    e = decay(s - 1j * omega, start_s, integration_s)
    rms = amplitudes(x)
    first = []
    for k, stay in enumerate(stays):
        column, rest = z[stay] * e[stay] * weight[stay], (1 - z[stay] * steady[stay]) * weight[stay]
        first.append(np.vdot(column, rest) / (np.vdot(column, column).real + rms[k] ** -2))
    a = np.array(first)
    steps = np.zeros(len(frequency_hz))
    for _ in range(3):
        rms, size = amplitudes(x), abs(a)
        start = np.concatenate([x[:5], (a / rms).real, (a / rms).imag, steps])
        # Steps that are no unknowns stay where they are.
        free = np.concatenate([np.ones(5 + 2 * n, bool), ~begins])

        def some(y):
            full = start.copy()
            full[free] = y
            return residuals(full, rms, size)

        found = least_squares(some, start[free], method="lm", xtol=1e-12, ftol=1e-12)
        start[free] = found.x
        x, steps = start[:5], start[5 + 2 * n :]
        a = (start[5 : 5 + n] + 1j * start[5 + n : 5 + 2 * n]) * rms
    of = np.linalg.inv(found.jac.T @ found.jac)[:5, :5]
    ratio = of[3, 3] / x[3] ** 2 + of[2, 2] / x[2] ** 2 - 2 * of[2, 3] / (x[2] * x[3])
    return float(np.exp(x[0])), np.sqrt([of[0, 0], of[1, 1], of[2, 2] / x[2] ** 2, ratio])


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
    readings, every_reading = defaultdict(list), defaultdict(list)
    for row in table(data / "readings.csv"):
        every_reading[row["sweep"]].append(row)
        if row["flag"] == "normal":
            readings[row["sweep"]].append(row)

    failures = []
    mine, circuit_ratios = {}, defaultdict(list)
    worst = 0.0
    sweeps = {sweep["sweep"]: sweep for sweep in table(data / "sweeps.csv")}
    left_out = {}
    for line in (data / "records.jsonl").read_text().splitlines():
        record = json.loads(line)["record"]
        if record["kind"] == "sweep":
            left_out[record["number"]] = record["outcome"].get("left_out", 0)
    for sweep in sweeps.values():
        if sweep["outcome"] != "accepted":
            continue
        rows = readings[sweep["sweep"]]
        column = lambda name: np.array([float(row[name]) for row in rows])
        frequency = column("frequency_hz")
        # What a survey found: the errors of the analyzer, of its phase, rad, and of the first gap, s, and the dispersion, F.
        bench = {name.removeprefix("fit_bench_"): float(value or 0) for name, value in rows[0].items()
                 if name.startswith("fit_bench_")}
        phase, first_gap = bench["phase_rad"], bench["first_gap_s"]
        impedance = column("resistance_ohm") + 1j * column("reactance_ohm")
        impedance = impedance * np.exp(-1j * phase)
        if bench["dispersion_f"] != 0:
            farad = bench["dispersion_f"] * np.log(2 * frequency / (bench["min_hz"] + bench["max_hz"]))
            impedance = impedance / (1 - impedance * 2j * np.pi * frequency * farad)
        times = [column(name) for name in ("started_s", "settle_s", "integration_s")]
        names = ("resonance_hz", "quality_factor", "static_capacitance_f", "capacitance_ratio")
        stated = [*np.log([float(sweep[name]) for name in names]), float(sweep["loss_tangent"])]
        theirs, sigma = float(sweep["resonance_hz"]), float(sweep["sigma_hz"])
        everything = np.ones(len(rows), bool)
        # The record says how many readings were left out, and not which.
        masks = [everything]
        if left_out.get(int(sweep["sweep"])) == 1:
            masks = [everything & (np.arange(len(rows)) != k) for k in range(len(rows))]
        found = [
            fit(frequency[mask], impedance[mask], *[time[mask] for time in times], first_gap, stated=stated)
            for mask in masks
        ]
        mine[sweep["sweep"]], circuit_sigmas = min(found, key=lambda one: abs(one[0] - theirs))
        for name, here in zip(names, circuit_sigmas):
            column, _, _ = CIRCUIT_SIGMAS[name]
            circuit_ratios[column].append(float(sweep[column]) / float(sweep[name]) / here)
        difference = abs(mine[sweep["sweep"]] - theirs) / sigma
        worst = max(worst, difference)
        if difference > SIGMAS:
            failures.append(f"sweep {sweep['sweep']}: {theirs} Hz, here {mine[sweep['sweep']]}")
    print(f"{len(mine)} sweeps, the largest difference is {worst:.4f} standard deviations")
    for column, least, most in CIRCUIT_SIGMAS.values():
        ratios = circuit_ratios[column]
        print(f"{column}: {min(ratios):.2f} to {max(ratios):.2f} of what is found here")
        if not all(least < ratio < most for ratio in ratios):
            failures.append(f"{column}: {min(ratios)} to {max(ratios)} of what is found here")

    touches = [touch for touch in table(data / "touches.csv") if touch["status"] == "measured"]
    shifts = defaultdict(list)
    blind = []
    of_row = defaultdict(list)
    for index, touch in enumerate(touches):
        reference = mine[touch["no_load_sweep"]]
        if touch["next_no_load_sweep"]:
            # Between both references, as far along as the table says.
            ends = [float(sweeps[touch[name]]["resonance_hz"]) for name in ("no_load_sweep", "next_no_load_sweep")]
            way = (float(touch["no_load_hz"]) - ends[0]) / (ends[1] - ends[0]) if ends[0] != ends[1] else 0.0
            if not -1e-6 <= way <= 1 + 1e-6:
                failures.append(f"{touch['step']}: the reference {touch['no_load_hz']} Hz is not between {ends}")
            reference += way * (mine[touch["next_no_load_sweep"]] - reference)
        shift = mine[touch["sweep"]] - reference
        if abs(shift - float(touch["shift_hz"])) > SIGMAS * float(touch["shift_sigma_hz"]):
            failures.append(f"{touch['step']}: shift {touch['shift_hz']} Hz, here {shift}")
        if touch["phase"] == "main":
            key = (touch["sample"], touch["direction"], float(touch["angle_deg"]))
            shifts[key].append(shift)
            of_row[key].append(index)
        else:
            blind.append((touch["sample"], shift))

    shared = references.covariance(touches, sweeps, every_reading)
    stated = {(s["sample"], s["direction"], s["angle_deg"]): s for s in result["shifts"]}
    for key, values in shifts.items():
        row = stated.get(key)
        if row is None or abs(row["shift_hz"] - np.mean(values)) > SIGMAS * row["sigma_hz"]:
            failures.append(f"{key}: table {row}, here {np.mean(values)}")
            continue
        # Each touch by itself, and what two touches share of their references.
        some = np.ix_(of_row[key], of_row[key])
        together = shared[some].copy()
        np.fill_diagonal(together, [float(touches[index]["shift_sigma_hz"]) ** 2 for index in of_row[key]])
        sigma = np.sqrt(together.sum()) / len(values)
        if abs(sigma / row["sigma_hz"] - 1) > SIGMA_REL:
            failures.append(f"{key}: standard deviation {row['sigma_hz']} Hz, here {sigma}")
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
