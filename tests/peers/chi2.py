#!/usr/bin/env python3
"""χ² of the model of a run and its verdict, from what the run exports and by the text of docs/numbers.md.

Usage: chi2.py RUN.json   (the output of `rigd run … --json`)

Reads `touches.csv`, `sweeps.csv`, `readings.csv` and `rig.toml` of the run. The stiffness of each main touch is found with the rod of
`beam.py`, which shares nothing with the beams of rigd. Exits 1 when χ² for each degree of freedom differs by more
than 2 %, the degrees of freedom differ, a residual differs by more than 0.05 standard deviations, or the
verdict is another one.
"""

import csv
import json
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

import numpy as np
from scipy.stats import chi2 as chi2_distribution

import beam
import references

CHI2_REL, RESIDUAL = 0.02, 0.05
# Steps of the slopes over depth, mm, and angle, degrees.
STEP_MM, STEP_DEG = 1e-3, 0.1
# Stiffnesses at which the shift of a pose is computed, over those of the samples; it is smooth in between.
NODES = 6


class Pose:
    """The shift of a pose, and its slopes over depth and angle, as functions of the stiffness."""

    def __init__(self, rod, model, angle_deg, direction, depth_mm, stiffness_mpa):
        low, high = np.log(stiffness_mpa[0]), np.log(stiffness_mpa[-1])
        angle = (2 * np.arange(NODES) + 1) / (2 * NODES) * np.pi
        self.logs = (low + high) / 2 + (high - low) / 2 * np.cos(angle)
        self.depth_mm = depth_mm

        def shifts(depth_mm, angle_deg):
            """Logarithms of the shifts, Hz. A negative angle leans the surface the other way."""
            side = direction if angle_deg >= 0 or direction == "left" else opposite(direction)
            found = []
            for log in self.logs:
                contact = beam.Contact(np.exp(log), abs(angle_deg), side, depth_mm, *model)
                found.append(rod.resonance(contact)["resonance_hz"] - rod.free["resonance_hz"])
            return np.polynomial.Polynomial.fit(self.logs, np.log(found), NODES - 1)

        slope = lambda after, before, width: (after - before) * (1 / width)
        self.shift = shifts(depth_mm, angle_deg)
        deeper, higher = shifts(depth_mm + STEP_MM, angle_deg), shifts(depth_mm - STEP_MM, angle_deg)
        self.per_mm = slope(deeper, higher, 2 * STEP_MM)
        steeper, flatter = shifts(depth_mm, angle_deg + STEP_DEG), shifts(depth_mm, angle_deg - STEP_DEG)
        self.per_deg = slope(steeper, flatter, 2 * STEP_DEG)

    def log_young(self, shift_hz, depth_mm):
        """The logarithm of the stiffness for a shift at a depth near that of the pose."""
        log = self.logs.mean()
        for _ in range(50):
            excess = self.shift(log) + self.per_mm(log) * (depth_mm - self.depth_mm) - np.log(shift_hz)
            step = excess / self.shift.deriv()(log)
            log -= step
            if abs(step) < 1e-10:
                return log
        raise RuntimeError(f"no stiffness for {shift_hz} Hz")


def opposite(direction):
    return {"front": "back", "back": "front"}[direction]


def main():
    result = json.loads(Path(sys.argv[1]).read_text())
    stated, data = result["model"], Path(result["data"])
    rig = tomllib.loads((data / "rig.toml").read_text())
    with open(data / "touches.csv", newline="") as file:
        measured = [row for row in csv.DictReader(file) if row["status"] == "measured"]
    main = [row for row in measured if row["phase"] == "main"]
    number = lambda rows, key: np.array([float(row[key]) for row in rows])

    # 1. The model: the sensor of the rig file with what was learnt.
    sensor = {**rig["sensor"], "arm_mm": stated["arm_mm"]["value"]}
    if sensor["law"] != "sneddon" or sensor["poisson"] != 0.5 or sensor["tissue_loss"] != 0.1:
        raise SystemExit("the contact of beam.py is Sneddon's, incompressible, with a loss of 0.1")
    rod = beam.Rod(sensor, rig["geometry"]["probe_radius_mm"])
    model = stated["depth"] == "stage", stated["tangential_ratio"]["value"]
    learnt = [stated[key]["sigma"] is not None for key in ("tangential_ratio", "arm_mm")]

    # 2. The shifts, as a sensor with the described free resonance would have them.
    scale = rod.free["resonance_hz"] / number(main, "no_load_hz")
    shift, shift_sigma = scale * number(main, "shift_hz"), scale * number(main, "shift_sigma_hz")

    # 3. The logarithm of each stiffness, and its variance.
    uncertainty = rig["sensor"]["uncertainty"]
    surface_2 = np.mean(number(measured, "surface_sigma_mm") ** 2)
    depth, known = number(main, "indentation_mm"), number(main, "stiffness_mpa")
    poses = [(row["direction"] if float(row["angle_deg"]) else "front", float(row["angle_deg"])) for row in main]
    tables = {
        (side, angle): Pose(rod, model, angle, side, depth.mean(), [0.6 * known.min(), 1.7 * known.max()])
        for side, angle in set(poses)
    }
    logs, variances, of_depth, per_hz = [], [], [], []
    for pose, hz, sigma, mm in zip(poses, shift, shift_sigma, depth):
        table = tables[pose]
        log = table.log_young(hz, mm)
        per_log = table.shift.deriv()(log)
        depth_2 = uncertainty["depth_mm"] ** 2 + surface_2
        parts = [
            (sigma / hz / per_log) ** 2,
            (table.per_mm(log) / per_log) ** 2 * depth_2,
            (table.per_deg(log) / per_log * uncertainty["angle_deg"]) ** 2,
            uncertainty["sample_rel"] ** 2,
        ]
        logs.append(log)
        variances.append(sum(parts))
        of_depth.append(parts[1])
        per_hz.append(1 / hz / per_log)
    logs, weights = np.array(logs), 1 / np.array(variances)

    # 4. The residuals of each sample about its mean, and χ².
    samples = np.array([row["sample"] for row in main])
    residuals = logs.copy()
    for sample in set(samples):
        own = samples == sample
        residuals[own] -= np.average(logs[own], weights=weights[own])
    sigmas = residuals * np.sqrt(weights)
    freedom = len(main) - len(set(samples)) - sum(learnt)
    chi2 = float(sigmas @ sigmas)

    # 5. The probability of each test by chance, and the verdict. What the touches share of their references:
    with open(data / "sweeps.csv", newline="") as file:
        sweeps = {row["sweep"]: row for row in csv.DictReader(file)}
    readings = defaultdict(list)
    with open(data / "readings.csv", newline="") as file:
        for row in csv.DictReader(file):
            readings[row["sweep"]].append(row)
    slope = np.array(per_hz) * scale
    of_references = np.outer(slope, slope) * references.covariance(main, sweeps, readings)
    np.fill_diagonal(of_references, 0)

    def by_chance(value, own, mean, half_variance):
        """The probability of χ² of these touches about the means of their samples, with this mean and half of this variance
        without what they share of their references."""
        about = np.eye(own.sum())
        for sample in set(samples[own]):
            here = samples[own] == sample
            unit = np.where(here, np.sqrt(weights[own]), 0)
            about -= np.outer(unit, unit) / (unit @ unit)
        root = np.sqrt(weights[own])
        left = about @ (np.outer(root, root) * of_references[np.ix_(own, own)]) @ about
        mean, half_variance = mean + np.trace(left), half_variance + 2 * np.trace(left) + (left**2).sum()
        return chi2_distribution.sf(value * mean / half_variance, mean**2 / half_variance)

    tilt = np.array([-angle if side == "back" else angle for side, angle in poses])
    shared = 0.5 * np.array(of_depth) * weights
    together = (tilt[:, None] == tilt[None, :]) & ~np.eye(len(main), dtype=bool)
    overlap = 1 + (np.outer(shared, shared) * together).sum() / len(main)
    of_sample = []
    for sample in set(samples):
        own = samples == sample
        of_sample.append(by_chance(float(sigmas[own] @ sigmas[own]), own, own.sum() - 1, own.sum() - 1))
    evidence = {one["pattern"]: one["probability"] for one in stated["evidence"]}
    of_samples = min(1.0, min(of_sample) * len(of_sample))
    of_chi2 = by_chance(chi2, np.ones(len(main), dtype=bool), freedom, freedom * overlap)
    # The known samples about one factor, each known to 3 %.
    factors, entering = [], []
    for sample in set(samples):
        own = samples == sample
        known = next((one["known_mpa"] for one in result["stiffness"] if one["sample"] == sample), None)
        if known is not None:
            mean = np.average(logs[own], weights=weights[own])
            factors.append((mean - np.log(known), 1 / weights[own].sum() + 0.03**2))
            entering.append(np.where(own, weights, 0) / weights[own].sum())
    of_known = 1.0
    if len(factors) > 1:
        ratio, variance = np.array(factors).T
        entering = np.array(entering)
        information = np.linalg.inv(np.diag(variance) + entering @ of_references @ entering.T)
        apart = ratio - (information @ ratio).sum() / information.sum()
        of_known = chi2_distribution.sf(float(apart @ information @ apart), len(factors) - 1)
    # Friction has half of the chance; χ² and the other tests share the rest. That of the known samples comes on top.
    share_of_friction = 0.5 if "friction" in evidence else 0.0
    others = 1 + len([name for name in evidence if name not in ("friction", "known")])
    share_of_other = (1 - share_of_friction) / others
    tests = evidence | {"chi2": of_chi2, "sample": of_samples, "known": of_known}
    least = min(p / (share_of_friction if name == "friction" else share_of_other) for name, p in tests.items())
    verdict = "rejected" if least < 1e-4 else "strained" if least < 0.02 else "holds"

    failures = []

    def check(what, own, theirs, is_same):
        print(f"{what}: {own}, stated {theirs}")
        if not is_same:
            failures.append(what)

    relative = chi2 / freedom / stated["chi2_per_dof"] - 1
    check("chi2_per_dof", f"{chi2 / freedom:.5f}", f"{stated['chi2_per_dof']:.5f}", abs(relative) < CHI2_REL)
    check("degrees_of_freedom", freedom, stated["degrees_of_freedom"], freedom == stated["degrees_of_freedom"])
    apart = np.abs(sigmas - number(main, "model_residual")).max()
    check("largest difference of a residual, σ", f"{apart:.4f}", f"below {RESIDUAL}", apart < RESIDUAL)
    theirs = evidence.get("sample", 1.0)
    check("evidence of one sample", f"{of_samples:.4f}", f"{theirs:.4f}", abs(of_samples - theirs) < 0.05)
    theirs = evidence.get("known", 1.0)
    check("evidence of the known samples", f"{of_known:.4f}", f"{theirs:.4f}", abs(of_known - theirs) < 0.05)
    print(f"χ² has a probability of {of_chi2:.4f} by chance, with an overlap of {overlap:.3f}")
    check("verdict", verdict, stated["verdict"], verdict == stated["verdict"])
    for failure in failures:
        print("DIFFERS", failure)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
