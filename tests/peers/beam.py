#!/usr/bin/env python3
"""The resonance of the sensor in contact, by a beam that shares nothing with `crates/contact`.

Usage: beam.py RIG_STUDY   (in the folder of the project; the sensor is that of config/rigs/simulated.toml)

The bimorph is a rod in space whose unknowns are the curvatures along it: six Legendre polynomials each for
the bending in the plane of the probe, across it, and for the twist. Positions and turns follow by
integration along the rod, for turns of any size. The force of the contact acts on the centre of the
ball, because a sphere without static friction is pushed through its centre; the rod is first brought to rest
under it and then vibrates about that state. Losses are complex moduli, and the electrodes act on the
curvature itself.

Every tier of `rig-study model` is then asked for the same contacts. Prints the largest difference of each
tier in each region, and exits 1 if one is above its tolerance, which is written in `REGIONS`. The effect of
the static force alone is compared with the table in `docs/studies/models/effects.csv`.
"""

import csv
import itertools
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
from scipy.linalg import eig
from scipy.optimize import brentq

# Legendre polynomials of each curvature, and steps of the integration along the rod.
TERMS, STEPS = 6, 32
# Step of a derivative, rad. The second difference of a position has eight correct digits then.
SMALL = 1e-3


class Contact:
    """Stiffness, angle, direction and depth of a contact. The samples are incompressible, have a loss of 0.1
    and stick, unless another tangential over normal stiffness is given."""

    def __init__(self, young_mpa, angle_deg, direction, indentation_mm, stage=False, ratio=None):
        self.young_mpa, self.angle_deg, self.direction = young_mpa, angle_deg, direction
        self.indentation_mm, self.stage = indentation_mm, stage
        self.poisson, self.loss = 0.5, 0.1
        # Mindlin: of a sphere that sticks to a half space.
        mindlin = 2 * (1 - self.poisson) / (2 - self.poisson)
        self.tangential_ratio = mindlin if ratio is None else ratio
        azimuth = {"front": 0.0, "back": np.pi, "left": np.pi / 2}[direction]
        tilt = np.radians(angle_deg)
        self.normal = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])

    def modulus_pa(self):
        return self.young_mpa * 1e6 / (1 - self.poisson**2)

    def at(self, depth_m, radius_m):
        """Force, N, and normal stiffness, N/m, of Sneddon's rigid sphere at a depth along the normal."""
        if depth_m <= 0:
            return 0.0, 0.0
        wanted = depth_m / radius_m
        x = brentq(lambda x: x * np.arctanh(x) - wanted, 1e-12, 1 - 1e-15, xtol=1e-15)
        a = x * radius_m
        force = self.modulus_pa() * ((a * a + radius_m**2) * np.arctanh(x) - a * radius_m)
        return force, 2 * self.modulus_pa() * a

    def words(self):
        words = [f"--stiffness-mpa={self.young_mpa}", f"--angle-deg={self.angle_deg}"]
        words += [f"--direction={self.direction}", f"--indentation-mm={self.indentation_mm}"]
        return words + (["--stage"] if self.stage else [])

    def __str__(self):
        held = "stage" if self.stage else "indentation"
        pose = f"{self.direction} {self.angle_deg}°"
        return f"{self.young_mpa} MPa, {pose}, {self.indentation_mm} mm of {held}"


class Rod:
    """The sensor of a rig file."""

    def __init__(self, sensor, radius_mm):
        mm, giga = 1e-3, 1e9
        piezo, core = sensor["piezo"], sensor["core"]
        self.length = sensor["length_mm"] * mm
        width, middle = sensor["width_mm"] * mm, sensor["core_thickness_mm"] * mm
        layer = sensor["piezo_thickness_mm"] * mm
        z = [-middle / 2 - layer, -middle / 2, middle / 2, middle / 2 + layer]

        def through(power, of_piezo, of_core):
            """The integral of a constant times a power of the height over the three layers."""
            parts = [(b ** (power + 1) - a ** (power + 1)) / (power + 1) for a, b in zip(z, z[1:])]
            return parts[0] * of_piezo + parts[1] * of_core + parts[2] * of_piezo

        moduli = piezo["modulus_gpa"] * giga, core["modulus_gpa"] * giga
        shears = piezo["shear_gpa"] * giga, core["shear_gpa"] * giga
        self.mass = width * through(0, piezo["density_kg_per_m3"], core["density_kg_per_m3"])
        self.roll = self.mass * width**2 / 12
        # Twist, bending in the plane of the probe, bending across it.
        self.rigidity = np.array([
            4 * width * through(2, *shears),
            width * through(2, *moduli),
            width**3 / 12 * through(0, *moduli),
        ])
        self.tip_mass = sensor["tip_mass_g"] * 1e-3
        self.tip_inertia = self.tip_mass * (sensor["tip_gyration_mm"] * mm) ** 2
        self.radius, self.arm = radius_mm * mm, np.array([0.0, 0.0, -sensor["arm_mm"] * mm])
        self.beam_loss, self.dielectric_loss = sensor["beam_loss"], sensor["dielectric_loss"]
        self.held_f = 2 * piezo["permittivity_nf_per_m"] * 1e-9 * width * self.length / layer
        # One volt on each of two layers makes this moment in every section.
        self.moment = 2 * piezo["coupling_c_per_m2"] * width * (z[2] + z[3]) / 2
        # The curvatures at two Gauss points of each step, over those of the polynomials, times the length.
        gauss = 0.5 / np.sqrt(3)
        points = [(np.arange(STEPS) + 0.5 + side * gauss) / STEPS for side in (-1, 1)]
        legendre = lambda x: np.polynomial.legendre.legvander(2 * x - 1, TERMS - 1)
        self.early, self.late = (legendre(x) for x in points)
        stiffness = np.outer(self.rigidity / self.length, 1 / (2 * np.arange(TERMS) + 1))
        self.elastic = np.diag(stiffness.ravel())
        self.free = self.resonance(Contact(1.0, 0.0, "front", 0.0))

    def shape(self, states):
        """Positions along the rod, m, and turns, for rows of unknowns: Magnus' series of fourth order."""
        states = np.atleast_2d(states)
        c = states.reshape(len(states), 3, TERMS)
        a, b = (np.einsum("kj,bij->bki", basis, c) for basis in (self.early, self.late))
        turn = np.broadcast_to(np.eye(3), (len(states), 3, 3))
        place = np.zeros((len(states), 3))
        h = 1.0 / STEPS
        # The body moves by one length along its own x axis: a motion with a turn and a shift.
        mean = 0.5 * h * (a + b)
        # Commutator of two motions with the same shift: of the turns, and of turn and shift.
        scale = np.sqrt(3) / 12 * h * h
        omega = mean + scale * np.cross(a, b)
        along = np.array([1.0, 0.0, 0.0])
        shift = h * along + scale * (np.cross(a, along) - np.cross(b, along))
        turns, places = [turn], [place]
        for k in range(STEPS):
            step, left = motion(omega[:, k])
            place = place + np.einsum("bij,bjk,bk->bi", turn, left, shift[:, k])
            turn = turn @ step
            turns.append(turn)
            places.append(place)
        return self.length * np.stack(places, 1), np.stack(turns, 1)

    def centre(self, states):
        """The centre of the ball, with the clamp at the origin."""
        places, turns = self.shape(states)
        return places[:, -1] + turns[:, -1] @ self.arm

    def slopes(self, state):
        """Motions of all sections and their turns, in space, for each unknown."""
        n = len(state)
        steps = SMALL * np.vstack([np.eye(n), -np.eye(n)])
        places, turns = self.shape(state + steps)
        moved = (places[:n] - places[n:]) / (2 * SMALL)
        here = self.shape(state)[1][0]
        change = np.einsum("bkij,klj->bkil", (turns[:n] - turns[n:]) / (2 * SMALL), here)
        turned = np.stack([change[..., 2, 1], change[..., 0, 2], change[..., 1, 0]], -1)
        return moved, turned, here

    def at_rest(self, force, start=None):
        """The unknowns under a force on the centre of the ball, N. The force changes little of the stiffness, so
        that steps with the elastic one converge."""
        state = np.zeros(3 * TERMS) if start is None else start
        for _ in range(100):
            step = np.linalg.solve(self.elastic, self.pull(state, force)) - state
            state = state + step
            if np.abs(step).max() < 1e-9:
                return state
        raise RuntimeError(f"no rest under {force} N")

    def pull(self, state, force):
        """How the work of a constant force on the centre of the ball changes with each unknown."""
        unit = SMALL * np.eye(len(state))
        work = self.centre(np.vstack([state + unit, state - unit])) @ force
        return (work[: len(state)] - work[len(state) :]) / (2 * SMALL)

    def bend(self, state, force):
        """The second derivative of that work."""
        n = len(state)
        unit = SMALL * np.eye(n)
        i, j = np.array(list(itertools.combinations_with_replacement(range(n), 2))).T
        corners = [state + s * unit[i] + t * unit[j] for s, t in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        work = self.centre(np.vstack(corners)).reshape(4, len(i), 3) @ force
        second = np.zeros((n, n))
        second[i, j] = (work[0] - work[1] - work[2] + work[3]) / (4 * SMALL**2)
        second[j, i] = second[i, j]
        return second

    def rest(self, contact):
        """The state at rest, force and normal stiffness; a held stage also moves the ball."""
        depth = contact.indentation_mm * 1e-3 * contact.normal[2]
        if depth <= 0:
            return np.zeros(3 * TERMS), 0.0, 0.0
        if contact.stage:
            start, state = self.arm + [self.length, 0, 0], np.zeros(3 * TERMS)

            def excess(indented):
                nonlocal state
                state = self.at_rest(contact.at(indented, self.radius)[0] * contact.normal, state)
                return indented + contact.normal @ (self.centre(state)[0] - start) - depth

            depth = brentq(excess, 1e-9, depth, xtol=1e-10)
        force, stiffness = contact.at(depth, self.radius)
        return self.at_rest(force * contact.normal), force, stiffness

    def resonance(self, contact, is_pushed=True):
        """Series resonance, Hz, quality, C0 and C1/C0. The force of the contact may be left out."""
        state, force, normal = self.rest(contact)
        if not is_pushed:
            state = np.zeros_like(state)
        moved, turned, turns = self.slopes(state)
        n = len(state)
        # Masses by Simpson's rule along the rod.
        weights = np.ones(STEPS + 1)
        weights[1:-1:2], weights[2:-1:2] = 4, 2
        weights *= self.length / (3 * STEPS)
        mass = self.mass * np.einsum("k,aki,bki->ab", weights, moved, moved)
        own = np.einsum("kji,bkj->bki", turns, turned)
        mass += self.roll * np.einsum("k,ak,bk->ab", weights, own[..., 0], own[..., 0])
        mass += self.tip_mass * moved[:, -1] @ moved[:, -1].T
        mass += self.tip_inertia * own[:, -1, :2] @ own[:, -1, :2].T
        stiffness = (1 + 1j * self.beam_loss) * self.elastic
        if force > 0:
            if is_pushed:
                stiffness = stiffness - self.bend(state, force * contact.normal)
            lever = turns[-1] @ self.arm - self.radius * contact.normal
            point = moved[:, -1] + np.cross(turned[:, -1], lever)
            across = point @ contact.normal
            along = point - np.outer(across, contact.normal)
            sideways = contact.tangential_ratio * along @ along.T
            held = normal * (np.outer(across, across) + sideways)
            stiffness = stiffness + (1 + 1j * contact.loss) * held
        rad2, modes = eig(stiffness, mass)
        first = np.argmin(rad2.real)
        # The electrodes load the mean curvature in the plane of the probe.
        drive = np.zeros(n)
        drive[TERMS] = self.moment
        shares = np.array([(drive @ mode) ** 2 / (mode @ mass @ mode) for mode in modes.T])
        others = np.arange(n) != first
        at = rad2[first].real
        held_f = self.held_f + (shares[others] / (rad2[others] - at)).sum().real
        return {
            "resonance_hz": np.sqrt(at) / (2 * np.pi),
            "q": at / rad2[first].imag,
            "capacitance_f": held_f,
            "capacitance_ratio": shares[first].real / at / held_f,
        }


def motion(omega):
    """The turn of a rotation vector, and the matrix that gives the shift of the motion."""
    angle = np.linalg.norm(omega, axis=-1)[:, None, None]
    safe = np.maximum(angle, 1e-4)
    # Below that angle, series that are exact to its fourth power.
    sinc = np.where(angle > safe / 2, np.sin(safe) / safe, 1 - angle**2 / 6)
    cosc = np.where(angle > safe / 2, (1 - np.cos(safe)) / safe**2, 0.5 - angle**2 / 24)
    rest = np.where(angle > safe / 2, (safe - np.sin(safe)) / safe**3, 1 / 6 - angle**2 / 120)
    x, y, z = omega.T
    zero = np.zeros_like(x)
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), -1, 0)
    square = cross @ cross
    return np.eye(3) + sinc * cross + cosc * square, np.eye(3) + cosc * cross + rest * square


def poses(*angles_deg):
    """Every direction at every angle; upright they are one."""
    leaning = itertools.product([angle for angle in angles_deg if angle > 0], ["front", "back", "left"])
    return [(0.0, "front")] * (0 in angles_deg) + list(leaning)


def contacts(stiffness_mpa, angles_deg, indentation_mm=0.5, stage=False):
    both = itertools.product(stiffness_mpa, poses(*angles_deg))
    return [Contact(young, *pose, indentation_mm, stage) for young, pose in both]


# The largest difference of a shift, Hz, that a tier may have; in parentheses a part of the shift. `None`: the
# tier must refuse all of them. T0 to T1 are the paper's own formula, whose constant is a fit to its two
# printed numbers. The reference lets twist and bending act on each other only through the contact, and is of
# second order in the turn of its end, which is up to 7° in the stiff contacts.
LUMPED = {"T0": 27, "T0b": 21, "T1": 21.5}
REFUSING = dict.fromkeys(["T0", "T0b", "T1", "T2", "E1"])
REGIONS = [
    (
        "samples of 0.02 to 1 MPa, indentation held",
        {},
        contacts([0.02, 0.235, 0.649, 1.0], [0, 15, 30, 45]) + contacts([0.32], [0, 45], 0.25),
        {**LUMPED, "T2": 1.6, "T2s": 1.6, "E1": 0.4, "E1s": 0.4, "exact": 0.08, "reference": 0.05},
    ),
    (
        "the same, held by the stage",
        {},
        contacts([0.045, 0.649], [0, 15, 30, 45], stage=True),
        {**REFUSING, "T2s": 0.4, "E1s": 0.16, "exact": 0.02, "reference": 0.008},
    ),
    (
        "steep, 60° and 75°",
        {},
        contacts([0.235, 0.649], [60, 75]),
        {"T2": 0.3, "T2s": 0.3, "E1": 0.14, "E1s": 0.14, "exact": 0.03, "reference": 0.02},
    ),
    (
        "stiff, 2 and 3 MPa",
        {},
        contacts([2.0, 3.0], [0, 15, 30, 45]),
        {
            **dict.fromkeys(["T0", "T0b"]),
            **{"T2": (0.055,), "T2s": (0.055,), "E1": (0.011,), "E1s": (0.011,)},
            **{"exact": (0.005,), "reference": (0.005,)},
        },
    ),
    (
        "very stiff and shallow, 10 and 20 MPa at 0.1 mm",
        {},
        contacts([10.0, 20.0], [0, 15, 30, 45], 0.1),
        {
            **dict.fromkeys(["T0", "T0b", "T1", "T2", "T2s"]),
            **{"E1": (0.03,), "E1s": (0.03,), "exact": (0.0015,), "reference": (0.0015,)},
        },
    ),
    (
        "another sensor",
        {"length_mm": 25, "width_mm": 4, "arm_mm": 4, "probe_radius_mm": 0.4, "tip_mass_g": 0.15},
        contacts([0.104, 0.649], [0, 30, 45], 0.4),
        {"T2": 0.9, "T2s": 0.9, "E1": 0.25, "E1s": 0.25, "exact": 0.04, "reference": 0.015},
    ),
]
# Of the free resonance, relative.
FREE = dict.fromkeys(["T0", "T0b", "T1", "T2", "T2s"], 2e-5)
FREE |= {"E1": 6e-4, "E1s": 6e-4, "exact": 1e-6, "reference": 1e-6}
# Of the circuit: quality and C0 relative to themselves, C1/C0 relative to that of the free sensor. Stiff contacts
# move the mode so far that the electrodes hardly see it.
CIRCUIT = {
    "reference": {"q": 0.002, "capacitance_f": 3e-4, "capacitance_ratio": 0.005},
    "E1": {"q": 0.05, "capacitance_f": 8e-4, "capacitance_ratio": 0.03},
}
CIRCUIT["E1s"] = CIRCUIT["E1"]
# Of the change of a shift by the static force, Hz.
FORCE_HZ = 0.04


class Judge:
    """Answers of `rig-study model` against those of a rod."""

    def __init__(self, study, sensor):
        self.study, self.sensor, self.failures = study, sensor, []

    def ask(self, tier, sensor, contact):
        keys = ["length_mm", "width_mm", "arm_mm", "tip_mass_g"]
        words = [f"--{key.replace('_', '-')}={sensor[key]}" for key in keys]
        words += [f"--radius-mm={sensor['probe_radius_mm']}", "--law=sneddon", *contact.words()]
        found = subprocess.run([self.study, "model", tier, "--json", *words], capture_output=True, text=True)
        return json.loads(found.stdout)

    def check(self, what, found, limit, contact):
        if not found <= limit:
            self.failures.append(f"{what}: {found:.4g} is above {limit:.4g}: {contact}")

    def region(self, name, change, asked, tolerances):
        sensor = {**self.sensor, **change}
        rod = Rod(sensor, sensor["probe_radius_mm"])
        own = [rod.resonance(contact) for contact in asked]
        shifts = [circuit["resonance_hz"] - rod.free["resonance_hz"] for circuit in own]
        print(f"{name}: {len(asked)} contacts, shifts of {min(shifts):.2f} to {max(shifts):.2f} Hz")
        for tier, tolerance in tolerances.items():
            answers = [self.ask(tier, sensor, contact) for contact in asked]
            taken = [answer["status"] == "ok" for answer in answers]
            if not all(taken) if tolerance is not None else any(taken):
                self.failures.append(f"{name}: {tier} takes {sum(taken)} of {len(asked)} contacts")
            if tolerance is None:
                continue
            worst = 0.0
            for contact, circuit, shift, answer in zip(asked, own, shifts, answers):
                if answer["status"] != "ok":
                    continue
                limit = tolerance[0] * shift if isinstance(tolerance, tuple) else tolerance
                difference = abs(answer["shift_hz"] - shift)
                worst = max(worst, difference)
                self.check(f"{name}: shift of {tier}", difference, limit, contact)
                free = abs(answer["no_load_hz"] / rod.free["resonance_hz"] - 1)
                self.check(f"{name}: free resonance of {tier}", free, FREE[tier], contact)
                for key, most in CIRCUIT.get(tier, {}).items():
                    scale = (rod.free if key == "capacitance_ratio" else circuit)[key]
                    apart = abs(answer["circuit"][key] - circuit[key]) / scale
                    self.check(f"{name}: {key} of {tier}", apart, most, contact)
            print(f"  {tier:<10} within {worst:8.4f} Hz")

    def static_force(self, path):
        """The change of a shift without the static force against the table of effects."""
        rod = Rod(self.sensor, self.sensor["probe_radius_mm"])
        young_mpa = dict(zip("12345", [0.045, 0.104, 0.235, 0.320, 0.649]))
        with open(path, newline="") as file:
            rows = [row for row in csv.DictReader(file) if row["effect"] == "no static force"]
        worst = 0.0
        for row in rows:
            pose = float(row["angle_deg"]), row["direction"]
            contact = Contact(young_mpa[row["sample"]], *pose, 0.5)
            both = [rod.resonance(contact, is_pushed)["resonance_hz"] for is_pushed in (False, True)]
            own, theirs = both[0] - both[1], float(row["change_hz"])
            if row["sample"] == "5":
                print(f"sample 5 without the static force, {contact}: {own:+.3f} Hz, stated {theirs:+.3f}")
            worst = max(worst, abs(own - theirs))
            self.check("static force", abs(own - theirs), FORCE_HZ, contact)
        print(f"effect of the static force: {len(rows)} rows within {worst:.4f} Hz")


def main():
    rig = tomllib.loads(Path("config/rigs/simulated.toml").read_text())
    sensor = {"probe_radius_mm": rig["geometry"]["probe_radius_mm"], **rig["sensor"]}
    judge = Judge(sys.argv[1], sensor)
    for region in REGIONS:
        judge.region(*region)
    judge.static_force("docs/studies/models/effects.csv")
    for failure in judge.failures:
        print("DIFFERS", failure)
    sys.exit(1 if judge.failures else 0)


if __name__ == "__main__":
    main()
