#!/usr/bin/env python3
"""Runs of a bench that shares nothing with `crates/contact`, through the analysis of rigd.

Usage: truths.py RIG_STUDY [RUNS] [SEED] [CSV]   (in the folder of the project)

The sensor is the rod of `beam.py`. Each truth changes the tissue, the ball or the friction; none has a term in the
model of the analysis. The shifts of a run are read from a table of exact contacts, with the errors that the rig
file states, and `rig-study analyse` makes of them what a run of the daemon would: verdict, stiffness and intervals.

Prints for each truth and for touches at one depth and at two: the error of blind touches, the coverage of
their 95 % intervals and of those of the samples, and the share of runs in which the model is strained or rejected.
Writes the same to CSV. Exits 1 if the truth that is not changed is covered in less than 93 % or noticed in more
than 6 % of its runs.
"""

import csv
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np

from beam import Contact, Rod

SAMPLES_MPA = [0.045, 0.104, 0.235, 0.320, 0.649]
DIRECTIONS = ["front", "back", "left"]
AZIMUTH_DEG = {"front": 0.0, "back": 180.0, "left": 90.0}
ANGLES_DEG = [0.0, 15.0, 30.0, 45.0]
DEPTH_MM, HALFWAY_MM, BLIND = 0.5, 0.25, 50
# The errors of the rig file: shift, depth, surface, slope, point.
SHIFT_HZ, DEPTH_SD_MM, SURFACE_SD_MM, ANGLE_SD_DEG, POINT_REL = 0.3, 0.02, 0.002, 1.0, 0.03
# The table: nodes of the angle, and the steps of depth and logarithm of the stiffness for their slopes.
NODES, DEPTH_STEP_MM, LOG_STEP = 6, 0.02, 0.04
LEAST_DEG, MOST_DEG = -4.0, 49.0
HALF_95 = 1.959964


class Tissue(Contact):
    """A contact of a truth."""

    def __init__(self, truth, young_mpa, angle_deg, direction, indentation_mm):
        # A negative angle leans the surface the other way.
        super().__init__(young_mpa, abs(angle_deg), direction, indentation_mm, truth.stage, truth.ratio)
        if angle_deg < 0:
            self.normal[:2] *= -1
        self.truth = truth

    def at(self, depth_m, radius_m):
        force, stiffness = super().at(depth_m, radius_m)
        if self.truth.deep_over_top != 1.0 and depth_m > 0:
            # The contact feels the deep layer as far as its radius reaches it; the force is the integral.
            def times(depth):
                reach = super(Tissue, self).at(depth, radius_m)[1] / (2 * self.modulus_pa())
                share = 1 - np.exp(-((reach / self.truth.top_m) ** 2))
                return 1 + (self.truth.deep_over_top - 1) * share

            depths = np.linspace(0, depth_m, 9)[1:]
            slopes = [super(Tissue, self).at(d, radius_m)[1] * times(d) for d in depths]
            force = np.trapezoid([0.0, *slopes], [0.0, *depths])
            stiffness *= times(depth_m)
        return force * (1 - self.truth.relaxed), stiffness


class Truth:
    def __init__(self, name, stage=False, ratio=None, deep_over_top=1.0, top_m=3e-4, relaxed=0.0, offset_mm=(0, 0),
                 friction=None):
        self.name, self.stage, self.ratio = name, stage, ratio
        self.deep_over_top, self.top_m, self.relaxed = deep_over_top, top_m, relaxed
        self.offset_mm, self.friction = offset_mm, friction


TRUTHS = [
    Truth("nothing"),
    Truth("ball 0.6 mm off along and 0.4 mm across", offset_mm=(0.6, 0.4)),
    Truth("held by the stage and relaxed by 30 %", stage=True, relaxed=0.3),
    Truth("a layer twice as stiff below 0.3 mm", deep_over_top=2.0),
    Truth("a layer half as stiff below 0.3 mm", deep_over_top=0.5),
    Truth("slip at a friction of 0.7", friction=0.7),
    Truth("slip at a friction of 0.9", friction=0.9),
]


def needed_friction(rod, contact, steps=60):
    """The largest force along the surface over that across it while a ball that sticks is pressed in."""
    n = contact.normal
    zero = np.zeros(rod.elastic.shape[0])
    give = np.array([np.linalg.solve(rod.elastic, rod.pull(zero, force)) for force in np.eye(3)])
    small = 1e-6
    compliance = np.array([(rod.centre(small * one)[0] - rod.centre(zero)[0]) / small for one in give]).T
    side = np.array([0.0, 1.0, 0.0]) if abs(n[0]) > 0.5 else np.array([1.0, 0.0, 0.0])
    first = side - (side @ n) * n
    first /= np.linalg.norm(first)
    along = np.array([first, np.cross(n, first)])
    depth = contact.indentation_mm * 1e-3 * n[2]
    step = depth / steps
    down = np.array([0.0, 0.0, -1.0])
    forces, across, most = np.zeros(2), 0.0, 0.0
    for k in range(steps):
        stiffness = contact.at((k + 0.5) * step, rod.radius)[1]
        push = stiffness * step
        # Unknown: the move of the stage and both forces along the surface. The ball goes one step deeper, and what it
        # moves along the surface is taken by the tissue.
        a, b = np.zeros((3, 3)), np.zeros(3)
        moved = [down, compliance @ along[0], compliance @ along[1]]
        by_push = compliance @ (push * n)
        for row, axis in enumerate([n, *along]):
            a[row] = [axis @ one for one in moved]
            b[row] = -axis @ by_push
        b[0] -= step
        soft = 1 / (contact.tangential_ratio * stiffness)
        a[1, 1] += soft
        a[2, 2] += soft
        forces = forces + np.linalg.solve(a, b)[1:]
        across += push
        most = max(most, np.linalg.norm(forces) / across)
    return most


class Bench:
    """A table of the shifts of a truth: for each sample, direction and depth, over the angle."""

    def __init__(self, truth, sensor):
        self.truth = truth
        self.rod = Rod(sensor, sensor["probe_radius_mm"])
        self.rod.arm[:2] = np.array(truth.offset_mm) * 1e-3
        self.rod.free = self.rod.resonance(Contact(1.0, 0.0, "front", 0.0))
        x = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        self.angles = LEAST_DEG + (MOST_DEG - LEAST_DEG) * (x + 1) / 2
        self.to_series = np.linalg.inv(np.polynomial.chebyshev.chebvander(x, NODES - 1))
        poses = [(s, d, mm) for s in range(5) for d in DIRECTIONS for mm in (DEPTH_MM, HALFWAY_MM)]
        self.series = {pose: self.tabled(*pose) for pose in poses}

    def exact(self, young_mpa, angle_deg, direction, mm, ratio=None):
        contact = Tissue(self.truth, young_mpa, angle_deg, direction, mm)
        if ratio is not None:
            contact.tangential_ratio = ratio
        return self.rod.resonance(contact)["resonance_hz"] - self.rod.free["resonance_hz"]

    def tabled(self, sample, direction, mm):
        """The shift and its changes with stiffness and depth, the same when it slides, and the friction that a
        stuck ball needs, each as a series over the angle."""
        young = SAMPLES_MPA[sample]
        rows = []
        for angle in self.angles:
            row = []
            for ratio in [None] + ([0.0] if self.truth.friction else []):
                at = lambda log, by_mm: self.exact(young * np.exp(log), angle, direction, mm + by_mm, ratio)
                here = at(0, 0)
                row += [here, (at(LOG_STEP, 0) - here) / LOG_STEP, (at(0, DEPTH_STEP_MM) - here) / DEPTH_STEP_MM]
            if self.truth.friction:
                row.append(needed_friction(self.rod, Tissue(self.truth, young, angle, direction, mm)))
            rows.append(row)
        return self.to_series @ np.array(rows)

    def shift(self, sample, direction, mm, log, angle, by_mm):
        x = 2 * (np.clip(angle, LEAST_DEG, MOST_DEG) - LEAST_DEG) / (MOST_DEG - LEAST_DEG) - 1
        row = np.polynomial.chebyshev.chebval(x, self.series[sample, direction, mm])
        slides = self.truth.friction is not None and row[-1] > self.truth.friction
        here, by_log, by_depth = row[3:6] if slides else row[:3]
        return here + by_log * log + by_depth * by_mm

    def touch(self, rng, sample, direction, angle, place):
        point, slope = POINT_REL * rng.standard_normal(), ANGLE_SD_DEG * rng.standard_normal()
        surface = SURFACE_SD_MM * rng.standard_normal()
        half = np.sqrt(0.5)
        reference = half * SHIFT_HZ * rng.standard_normal()

        def read(mm):
            by_mm = place + half * DEPTH_SD_MM * rng.standard_normal() + surface
            own = half * SHIFT_HZ * rng.standard_normal()
            return self.shift(sample, direction, mm, np.log1p(point), angle + slope, by_mm) + reference + own

        touch = {
            "sample": sample, "angle_deg": angle, "azimuth_deg": AZIMUTH_DEG[direction], "indentation_mm": DEPTH_MM,
            "shift_hz": read(DEPTH_MM), "sigma_hz": SHIFT_HZ, "reference_sigma_hz": half * SHIFT_HZ,
        }
        halfway = {"indentation_mm": HALFWAY_MM, "shift_hz": read(HALFWAY_MM), "sigma_hz": half * SHIFT_HZ}
        return {**touch, "halfway": halfway}, SAMPLES_MPA[sample] * (1 + point)

    def run(self, rng):
        half = np.sqrt(0.5) * DEPTH_SD_MM
        places = half * rng.standard_normal((len(ANGLES_DEG), 2))
        main = []
        for sample in range(5):
            for direction in DIRECTIONS:
                for index, angle in enumerate(ANGLES_DEG):
                    place = places[index, int(direction == "back" and angle > 0)]
                    main.append(self.touch(rng, sample, direction, angle, place)[0])
        blind, truth_mpa = [], []
        for _ in range(BLIND):
            sample, direction = int(rng.integers(5)), DIRECTIONS[int(rng.integers(3))]
            touch, young = self.touch(rng, sample, direction, 45 * rng.random(), half * rng.standard_normal())
            blind.append(touch)
            truth_mpa.append(young)
        return {"main": main, "blind": blind, "known_mpa": SAMPLES_MPA}, truth_mpa


def at_one_depth(run):
    once = lambda touches: [{**touch, "halfway": None} for touch in touches]
    return {**run, "main": once(run["main"]), "blind": once(run["blind"])}


def judged(study, runs, truths_mpa):
    lines = "".join(json.dumps(run) + "\n" for run in runs)
    found = subprocess.run([study, "analyse"], input=lines, capture_output=True, text=True, check=True)
    answers = [json.loads(line) for line in found.stdout.splitlines()]
    errors, covered, samples, refused = [], [], [], 0
    for answer, truth_mpa in zip(answers, truths_mpa, strict=True):
        for young, truth in zip(answer["blind"], truth_mpa, strict=True):
            if young is None:
                refused += 1
                continue
            errors.append(young["stiffness_mpa"] / truth - 1)
            covered.append(abs(young["stiffness_mpa"] - truth) <= HALF_95 * young["sigma_mpa"])
        for one in answer["samples"]:
            apart = abs(one["stiffness_mpa"] - SAMPLES_MPA[one["sample"]])
            samples.append(apart <= HALF_95 * one["sigma_mpa"])
    noticed = [answer["verdict"] != "holds" for answer in answers]
    patterns = [answer["pattern"] for answer in answers if answer["pattern"]]
    return {
        "runs": len(answers),
        "refused": refused,
        "rms_percent": round(100 * float(np.sqrt(np.mean(np.square(errors)))), 1),
        "coverage_percent": round(100 * float(np.mean(covered)), 1),
        "samples_coverage_percent": round(100 * float(np.mean(samples)), 1),
        "noticed_percent": round(100 * float(np.mean(noticed)), 1),
        "pattern": max(set(patterns), key=patterns.count) if patterns else "",
    }


def main():
    study = sys.argv[1]
    runs = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    rig = tomllib.loads(Path("config/rigs/simulated.toml").read_text())
    sensor = {"probe_radius_mm": rig["geometry"]["probe_radius_mm"], **rig["sensor"]}
    rows, is_right = [], True
    for number, truth in enumerate(TRUTHS):
        bench = Bench(truth, sensor)
        rng = np.random.default_rng([seed, number])
        made = [bench.run(rng) for _ in range(runs)]
        touches, truths_mpa = [run for run, _ in made], [young for _, young in made]
        for depths, all_touches in (("one", [at_one_depth(run) for run in touches]), ("two", touches)):
            row = {"truth": truth.name, "depths": depths, **judged(study, all_touches, truths_mpa)}
            print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)
            rows.append(row)
            if number == 0:
                is_right &= row["coverage_percent"] >= 93 and row["noticed_percent"] <= 6
    if len(sys.argv) > 4:
        with open(sys.argv[4], "w", newline="") as file:
            table = csv.DictWriter(file, rows[0], lineterminator="\n")
            table.writeheader()
            table.writerows(rows)
    sys.exit(0 if is_right else 1)


if __name__ == "__main__":
    main()
