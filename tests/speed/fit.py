#!/usr/bin/env python3
"""The resonance fit of rigd beside those of scipy, lmfit and scikit-rf. See fit.sh, which calls it.

Sweeps of a Butterworth-Van Dyke circuit at 140 Hz with relative noise, even over 112 to 168 Hz. All
programs get the same numbers. A call goes from the arrays to the resonance: the start values are
looked for within it; rigd also finds the uncertainty and judges the readings.

RMSE/CRLB is the root of the mean square error over its Cramer-Rao bound for four unknowns. A result
that is not finite, or further than the linewidth from the truth, counts as lost and is left out of it.

The programs take turns sweep by sweep; rigd runs before and after, and the turn with the larger mean
counts. The goals are judged by mean, median and 99th percentile: the last two of rigd differ by what it
costs to look closer at the sweeps that seem unusual. The tenth percentiles show by how much other work on
the machine disturbs the others.
"""

import argparse
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import lmfit
import numpy as np
import skrf
from scipy.optimize import least_squares, leastsq
from skrf.qfactor import Qfactor
from skrf.vectorFitting import VectorFitting

RESONANCE_HZ, WINDOW_HZ, C0_FARAD = 140.0, (112.0, 168.0), 27e-9
ALARM_S = 2.0
# Both stop where a further step would be far below the uncertainty, and where rigd looks closer it
# takes the logarithm for the residual, which differs by the square of the noise. It may state a larger
# uncertainty, where it suspects more than noise, but not a smaller one.
AGREE_SIGMAS, AGREE_SIGMA = 0.2, 0.03
# How many times as long as rigd the others take, in the median over the kinds of sweeps.
GOALS = {"scipy lm, exact Jacobian": 150, "scikit-rf VectorFitting, y": 1000, "scikit-rf NLQFIT6": 1000}
# Microseconds of a fit by rigd, for each number of points.
GOALS_US = {101: {"mean": 10, "p99": 100}, 401: {"mean": 40}}
JUDGED = ("mean", "median", "p99")


def admittance(f, fs, q, c0, m):
    u = f / fs
    return 2j * np.pi * f * c0 * (1 + m / (1 - u * u + 1j * u / q))


class Cell:
    """Sweeps of one kind."""

    def __init__(self, q, k2, noise, points, count, seed):
        self.q, self.k2, self.noise, self.points = q, k2, noise, points
        rng = np.random.default_rng([seed, q, round(1e3 * k2), round(1e4 * noise), points])
        self.f = np.linspace(*WINDOW_HZ, points)
        step = self.f[1] - self.f[0]
        self.m = k2 / (1 - k2)
        self.fs = RESONANCE_HZ + step * rng.uniform(-1, 1, count)
        error = rng.standard_normal((count, points)) + 1j * rng.standard_normal((count, points))
        clean = np.array([1 / admittance(self.f, fs, q, C0_FARAD, self.m) for fs in self.fs])
        self.z = clean * (1 + noise * error)

    def write(self, path):
        head = np.array([len(self.z), self.points, *self.f])
        body = np.stack([self.z.real, self.z.imag], axis=-1)
        path.write_bytes(head.astype("<f8").tobytes() + body.astype("<f8").tobytes())

    def bound_hz(self):
        """Of the standard deviation of the resonance."""
        theta = np.log([RESONANCE_HZ, self.q, C0_FARAD, self.m])
        y = admittance(self.f, *np.exp(theta))
        jacobian = real(slopes(self.f, y, theta) / y)
        covariance = np.linalg.inv(jacobian @ jacobian.T) * self.noise**2
        return RESONANCE_HZ * np.sqrt(covariance[0, 0])

    def name(self):
        return f"Q {self.q}, k2 {self.k2}, noise {100 * self.noise:g} %, {self.points} points"


def real(rows):
    return np.concatenate([rows.real, rows.imag], axis=-1)


def slopes(f, y, theta):
    """Of the admittance, by the logarithms of fs, Q, C0 and C1/C0."""
    fs, q, c0, m = np.exp(theta)
    u = f / fs
    h = 1 / (1 - u * u + 1j * u / q)
    motional = 2j * np.pi * f * c0 * m * h
    by_fs = -motional * h * (2 * u * u - 1j * u / q)
    return np.array([by_fs, motional * h * 1j * u / q, y, motional])


def start(f, y):
    """The highest conductance, how wide it is half-way down, and the capacitance at the ends."""
    g = y.real
    top = np.argmax(g)
    low = g.min()
    wide = np.count_nonzero(g > 0.5 * (g[top] + low)) * (f[1] - f[0])
    c0 = 0.5 * (y.imag[0] / f[0] + y.imag[-1] / f[-1]) / (2 * np.pi)
    q = f[top] / wide
    m = max((g[top] - low) / (2 * np.pi * f[top] * c0) / q, 1e-4)
    return np.log([f[top], q, c0, m])


def residuals(theta, f, z):
    return real(z * admittance(f, *np.exp(theta)) - 1)


def jacobian_rows(theta, f, z):
    return real(z * slopes(f, admittance(f, *np.exp(theta)), theta))


def jacobian(theta, f, z):
    return jacobian_rows(theta, f, z).T


def scipy_exact(f, z):
    found = least_squares(residuals, start(f, 1 / z), jacobian, method="lm", args=(f, z))
    return np.exp(found.x[0])


def scipy_numeric(f, z):
    found = least_squares(residuals, start(f, 1 / z), method="lm", args=(f, z))
    return np.exp(found.x[0])


def minpack(f, z):
    """The routine behind it, with hardly any Python around it."""
    found, _ = leastsq(residuals, start(f, 1 / z), (f, z), jacobian_rows, col_deriv=True)
    return np.exp(found[0])


def lmfit_bounded(f, z):
    guess = np.exp(start(f, 1 / z))
    parameters = lmfit.Parameters()
    for name, value in zip(("fs", "q", "c0", "m"), guess):
        # In units of the guess: lmfit steps badly from numbers of very different size.
        parameters.add(name, value=1.0, min=0.0, max=100.0)

    def distance(parameters):
        factors = np.array([parameters[name].value for name in ("fs", "q", "c0", "m")])
        return real(z * admittance(f, *(guess * factors)) - 1)

    return guess[0] * lmfit.minimize(distance, parameters).params["fs"].value


def network(f, y):
    return skrf.Network(f=f, f_unit="Hz", s=y.reshape(-1, 1, 1), z0=50)


def vector_fitting(f, z):
    """One pair of poles, a constant and a capacitor, on the admittance, as the manual has it."""
    measured = skrf.Network(f=f, f_unit="Hz", z=z.reshape(-1, 1, 1), z0=50)
    return resonance_of_poles(VectorFitting(measured), "y")


def vector_fitting_lean(f, z):
    """The same without a conversion: the admittance is given out for a scattering parameter."""
    y = 1 / z
    return resonance_of_poles(VectorFitting(network(f, y / np.abs(y).mean())), "s")


def resonance_of_poles(fit, parameter):
    fit.vector_fit(n_poles_real=0, n_poles_cmplx=1, parameter_type=parameter, fit_proportional=True)
    return np.abs(fit.poles[0]) / (2 * np.pi)


def nlqfit6(f, z):
    """On the admittance without that of C0, which is told to it."""
    y = 1 / z - 2j * np.pi * f * C0_FARAD
    fit = Qfactor(network(f, y / np.abs(y).max()), res_type="transmission")
    return fit.fit(method="NLQFIT6").f_L


PEERS = {
    "scipy lm, exact Jacobian": scipy_exact,
    "scipy lm, numeric Jacobian": scipy_numeric,
    "MINPACK by leastsq, exact": minpack,
    "lmfit, bounded": lmfit_bounded,
    "scikit-rf VectorFitting, y": vector_fitting,
    "scikit-rf VectorFitting, lean": vector_fitting_lean,
    "scikit-rf NLQFIT6": nlqfit6,
}


class OutOfTime(Exception):
    """A call did not come back."""


def timed(call, f, z):
    def ring(*_):
        raise OutOfTime

    signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, ALARM_S)
    begin = time.perf_counter()
    try:
        found = call(f, z)
    except (OutOfTime, ArithmeticError, ValueError, np.linalg.LinAlgError):
        found = np.nan
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return found, 1e6 * (time.perf_counter() - begin)


class Times(NamedTuple):
    """Of one call, in microseconds."""

    p10: float
    median: float
    mean: float
    p99: float


class Rigd:
    """What the example program makes of a cell."""

    def __init__(self, program, path, rounds):
        out = subprocess.run([program, "fit", path, str(rounds)], capture_output=True, text=True, check=True)
        *lines, last = out.stdout.splitlines()
        self.times = Times(*(float(word) for word in last.split()[1:]))
        self.rows = [line.split(maxsplit=2) for line in lines]

    def column(self, index):
        return np.array([np.nan if row[0] == "refused" else float(row[index]) for row in self.rows])


def disagreements(cell, rigd):
    """Compares the fits with scipy's, where rigd asks for no more than the four elements.

    Gives back what is wrong, and in how many fits rigd states a larger uncertainty.
    """
    found, sigma, wrong, compared, wider = rigd.column(0), rigd.column(1), [], 0, 0
    for index, z in enumerate(cell.z):
        row = rigd.rows[index]
        if row[0] == "refused":
            wrong.append(f"sweep {index} is refused: {row[1]}")
        if row[-1] != "circuit":
            continue
        compared += 1
        fit = least_squares(residuals, start(cell.f, 1 / z), jacobian, method="lm", args=(cell.f, z))
        degrees = 2 * cell.points - 4
        variance = np.linalg.inv(fit.jac.T @ fit.jac)[0, 0] * 2 * fit.cost / degrees
        hz = np.exp(fit.x[0])
        sigma_hz = hz * np.sqrt(variance)
        off, stated = abs(found[index] - hz) / sigma_hz, sigma[index] / sigma_hz
        if not (off < AGREE_SIGMAS and stated > 1 - AGREE_SIGMA):
            wrong.append(f"sweep {index}: {found[index]} +- {sigma[index]} Hz, scipy {hz} +- {sigma_hz} Hz")
        wider += stated > 1 + AGREE_SIGMA
    if compared < 0.8 * len(cell.z):
        wrong.append(f"only {compared} of {len(cell.z)} sweeps were fitted with four elements")
    return wrong, wider


def accuracy(cell, found):
    """RMSE/CRLB, and how many are lost."""
    error = np.asarray(found) - cell.fs[: len(found)]
    kept = np.abs(error) < RESONANCE_HZ / cell.q
    lost = len(error) - np.count_nonzero(kept)
    ratio = np.sqrt(np.mean(error[kept] ** 2)) / cell.bound_hz() if kept.any() else np.nan
    return ratio, lost


def compare(cell, program, path, trials):
    """Prints the table of a cell; gives back the times of rigd and the times of the others over them."""
    print(f"\n{cell.name()} (load {os.getloadavg()[0]:.1f})")
    times = f"{'median':>9} {'p10':>8} {'mean':>8} {'p99':>8}"
    factors = " ".join(f"{'x ' + name:>8}" for name in JUDGED)
    print(f"{'microseconds a call':29} {times}  {factors}  {'RMSE/CRLB':>9} {'lost':>4}")
    before = Rigd(program, path, 50)
    results = {name: ([], []) for name in PEERS}
    for z in cell.z[:trials]:
        for name, call in PEERS.items():
            found, micros = timed(call, cell.f, z)
            results[name][0].append(found)
            results[name][1].append(micros)
    after = Rigd(program, path, 50)
    ours = max(before, after, key=lambda turn: turn.times.mean)
    say("rigd, with its verdict", ours.times, ours.times, accuracy(cell, ours.column(0)[:trials]))
    ratios = {}
    for name, (found, micros) in results.items():
        times = Times(*np.percentile(micros, [10, 50]), np.mean(micros), np.percentile(micros, 99))
        ratios[name] = {of: ratio(of, times, ours.times) for of in JUDGED}
        say(name, times, ours.times, accuracy(cell, found))
    return ours.times, ratios


def ratio(of, times, ours):
    return getattr(times, of) / getattr(ours, of)


def say(name, times, ours, precision):
    row = f"{times.median:9.2f} {times.p10:8.2f} {times.mean:8.2f} {times.p99:8.1f}"
    ratios = " ".join(f"{ratio(of, times, ours):8.1f}" for of in JUDGED)
    print(f"{name:29} {row}  {ratios}  {precision[0]:9.3f} {precision[1]:4}", flush=True)


def judge(measured):
    """Prints what became of the goals."""
    for name, goal in GOALS.items():
        for of in JUDGED:
            middle = statistics.median(ratios[name][of] for _, _, ratios in measured)
            verdict = "met" if middle >= goal else "not met"
            print(f"{name}, {of}: {middle:.1f} times that of rigd in the median of the kinds, "
                  f"goal {goal}: {verdict}")
    for cell, times, _ in measured:
        for of, goal_us in GOALS_US.get(cell.points, {}).items():
            found_us = getattr(times, of)
            verdict = "met" if found_us <= goal_us else "not met"
            print(f"rigd, {cell.name()}, {of}: {found_us:.1f} us, goal {goal_us} us: {verdict}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", help="the program speed")
    parser.add_argument("--quick", action="store_true", help="only whether rigd and scipy agree")
    parser.add_argument("--seed", type=int, default=20240601)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    kinds = [(q, k2, 0.005, 101) for q in (10, 30, 100) for k2 in (0.02, 0.1)]
    kinds += [(30, 0.1, 0.005, 21), (30, 0.1, 0.005, 401), (30, 0.1, 0.001, 101), (30, 0.1, 0.02, 101)]
    wrong, measured, wider, sweeps = [], [], 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for kind in kinds:
            cell = Cell(*kind, 40 if options.quick else 500, options.seed)
            path = Path(folder, "sweeps.f64")
            cell.write(path)
            found, more = disagreements(cell, Rigd(options.program, path, 1))
            wrong += [f"{cell.name()}: {text}" for text in found]
            wider, sweeps = wider + more, sweeps + len(cell.z)
            if not options.quick:
                measured.append((cell, *compare(cell, options.program, path, 100)))
    print(f"\n{sweeps} sweeps of {len(kinds)} kinds, seed {options.seed}: "
          + (f"{len(wrong)} disagreements with scipy" if wrong else "rigd and scipy agree")
          + f"; in {wider} rigd states a larger uncertainty")
    for text in wrong[:20]:
        print(text)
    if measured:
        judge(measured)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
