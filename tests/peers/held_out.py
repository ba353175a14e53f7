"""Sweeps of which the truth is known, from a model that shares nothing with rigd, through `rigd fit`.

Each scene is a piezo sensor in an analyzer: an exact motion in time where the sweep is fast, a
cubic spring where the drive is strong, noise of the size that analyzers have. `rigd fit` must find
the series resonance within five of its own standard deviations or refuse; what it may not do is to
be wrong and sure of it.

    held_out.py RIGD [TRIALS] [SEED]
"""

import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

C0 = 27e-9
LOW_HZ, HIGH_HZ = 112.0, 168.0
# Beyond this many of its own standard deviations an accepted value is wrong.
SIGMAS = 5.0
ACCEPTED, REFUSED = 0, 3


class Scene:
    """What is swept and how."""

    def __init__(self, rng):
        self.rng = rng
        self.fs = rng.uniform(125.0, 155.0)
        self.q = float(np.exp(rng.uniform(np.log(8.0), np.log(120.0))))
        self.k2 = float(np.exp(rng.uniform(np.log(0.015), np.log(0.12))))
        self.loss = float(rng.choice([0.0, 0.005, 0.02]))
        self.noise = float(np.exp(rng.uniform(np.log(0.001), np.log(0.02))))
        self.points = int(rng.choice([51, 101, 201]))

        self.moved_hz = None

    def at(self, seconds):
        """The resonance of a moment of a sweep with one reading a second."""
        return self.fs + self.moved_hz * (seconds / self.points - 0.5)

    def grid(self):
        return np.linspace(LOW_HZ, HIGH_HZ, self.points)

    def motional_farad(self):
        return C0 * self.k2 / (1.0 - self.k2)

    def admittance(self, f, fs=None):
        """Of the circuit in its steady state; `fs` may differ from point to point."""
        u = f / (self.fs if fs is None else fs)
        motional = self.motional_farad() / (1.0 - u * u + 1j * u / self.q)
        return 2j * np.pi * f * (C0 * (1.0 - 1j * self.loss) + motional)

    def read(self, f, y):
        """Impedances as they are read, with noise in proportion."""
        n = self.rng.standard_normal((2, len(f)))
        return f, (1.0 + self.noise * (n[0] + 1j * n[1])) / y


def nominal(s):
    f = s.grid()
    return s.read(f, s.admittance(f))


def low_figure_of_merit(s):
    s.q, s.k2 = s.rng.uniform(5.0, 12.0), s.rng.uniform(0.005, 0.02)
    return nominal(s)


def at_the_edge(s):
    edge = s.rng.choice([LOW_HZ, HIGH_HZ])
    s.fs = edge + s.rng.normal(0.0, 0.5) * s.fs / s.q
    return nominal(s)


def beyond(s):
    away = s.rng.uniform(1.5, 8.0) * 140.0 / s.q
    s.fs = s.rng.choice([LOW_HZ - min(away, 30.0), HIGH_HZ + min(away, 40.0)])
    return nominal(s)


def two_modes(s):
    """Nearer than most of a linewidth two modes look like one, at a mean frequency."""
    f = s.grid()
    fs2 = s.fs * (1.0 + s.rng.choice([-1, 1]) * s.rng.uniform(0.8, 4.0) / s.q)
    part, q2 = s.rng.uniform(0.02, 0.4), s.q * s.rng.uniform(0.5, 2.0)
    u = f / fs2
    second = part * s.motional_farad() / (1.0 - u * u + 1j * u / q2)
    return s.read(f, s.admittance(f) + 2j * np.pi * f * second)


def drift_there_and_back(s):
    f = s.grid()
    f = np.concatenate([f, f[::-1]])
    moved = s.rng.uniform(0.05, 3.0) * s.rng.choice([-1, 1])
    return s.read(f, s.admittance(f, s.fs + moved * np.linspace(-0.5, 0.5, len(f))))


def drift_one_way(s):
    """One reading a second, up or down. What is found must be the resonance of the moment it is for,
    which holds to first order: for drifts up to a fiftieth of the speed of the sweep."""
    f = s.grid()[:: s.rng.choice([-1, 1])]
    s.moved_hz = s.rng.uniform(0.05, 1.0) * s.rng.choice([-1, 1])
    return s.read(f, s.admittance(f, s.at(np.arange(len(f)) + 0.95)))


def outliers(s):
    f, z = nominal(s)
    hit = s.rng.random(len(f)) < s.rng.uniform(0.01, 0.1)
    return f, z * np.where(hit, s.rng.uniform(0.3, 3.0, len(f)), 1.0)


def none(s):
    s.k2 = 1e-9
    return nominal(s)


def in_time(s, f, settle_s, cycles):
    """Admittance read from the exact motion under a drive that never stops or jumps in phase.

    q'' + 2g q' + w0² q = V/L is one complex mode: x' = r x + V/(2jL w), q = 2 Re x.
    """
    w0 = 2.0 * np.pi * s.fs
    g = w0 / (2.0 * s.q)
    wd = np.sqrt(w0 * w0 - g * g)
    r = -g + 1j * wd
    drive = s.motional_farad() * w0 * w0 / (2j * wd)
    x, phase = 0.0 + 0.0j, s.rng.uniform(0.0, 2.0 * np.pi)
    read = []
    for fi in f:
        w, at = 2.0 * np.pi * fi, np.exp(1j * phase)
        plus, minus = 0.5 * drive * at / (1j * w - r), 0.5 * drive / at / (-1j * w - r)
        left = x - plus - minus
        stop = settle_s + cycles / fi

        def integral(rate):
            """∫ exp(rate·t) over the integration, over its length."""
            a, b = settle_s, stop
            return 1.0 if abs(rate) < 1e-12 else (np.exp(rate * b) - np.exp(rate * a)) / rate / (b - a)

        # The current is 2 Re x'; what is read is 2⟨i exp(−jwt)⟩ over the drive's phasor.
        terms = [(1j * w * plus, 1j * w), (-1j * w * minus, -1j * w), (r * left, r)]
        phasor = sum(2.0 * c * integral(k - 1j * w) for c, k in terms)
        phasor += sum(2.0 * np.conj(c) * integral(np.conj(k) - 1j * w) for c, k in terms)
        read.append(phasor / at)
        x = plus * np.exp(1j * w * stop) + minus * np.exp(-1j * w * stop) + left * np.exp(r * stop)
        phase += w * stop
    return np.array(read) + 2j * np.pi * f * C0 * (1.0 - 1j * s.loss)


def too_fast(s):
    f = s.grid()
    if s.rng.random() < 0.5:
        f = f[::-1]
    dwell = s.rng.uniform(0.0, 4.0) * s.q / (np.pi * s.fs)
    return s.read(f, in_time(s, f, dwell, int(s.rng.choice([2, 4, 10]))))


def settled_in_time(s):
    f = s.grid()
    return s.read(f, in_time(s, f, 12.0 * s.q / (np.pi * s.fs), 10))


def bistable(s):
    """A spring that softens with the square of the amplitude, followed along the sweep.

    The relative change of stiffness at the linear peak, times Q; from 1.6 on the peak bends over. Far
    less of it hides in the noise of a single sweep: only a step of the drive shows it.
    """
    strength = s.rng.uniform(1.0, 3.5)
    f = s.grid()
    f = f if s.rng.random() < 0.5 else f[::-1]
    both = s.rng.random() < 0.5
    f = np.concatenate([f, f[::-1]]) if both else f
    y, a2 = [], 0.0
    for fi in f:
        u = fi / s.fs
        # |x|² (( 1 − κ|x|² − u²)² + (u/Q)²) = 1/Q², with |x| = 1 at the linear peak.
        k = strength / s.q
        poly = [k * k, -2.0 * k * (1.0 - u * u), (1.0 - u * u) ** 2 + (u / s.q) ** 2, -1.0 / s.q**2]
        roots = np.roots(poly)
        real = np.sort(roots[abs(roots.imag) < 1e-7].real)
        a2 = real[np.argmin(abs(real - a2))]
        y.append(1.0 / (1.0 - k * a2 - u * u + 1j * u / s.q))
    motional = s.motional_farad() * np.array(y)
    return s.read(f, 2j * np.pi * f * (C0 * (1.0 - 1j * s.loss) + motional))


def sparse(s):
    s.points = int(s.rng.integers(7, 16))
    return nominal(s)


def quantised(s):
    s.noise = 1e-4
    f, z = nominal(s)
    digits, degrees = [(4, 0.01), (3, 0.1), (2, 1.0)][s.rng.integers(0, 3)]
    step = 10.0 ** (np.floor(np.log10(abs(z))) - digits + 1)
    magnitude = np.round(abs(z) / step) * step
    return f, magnitude * np.exp(1j * np.radians(np.round(np.degrees(np.angle(z)) / degrees) * degrees))


def noiseless(s):
    s.noise = 0.0
    return nominal(s)


# Each kind, and the part of its sweeps that may be refused.
KINDS = {
    nominal: 0.01,
    settled_in_time: 0.02,
    noiseless: 0.0,
    low_figure_of_merit: 1.0,
    at_the_edge: 1.0,
    beyond: 1.0,
    two_modes: 1.0,
    drift_there_and_back: 1.0,
    drift_one_way: 0.2,
    outliers: 1.0,
    none: 1.0,
    too_fast: 1.0,
    bistable: 1.0,
    sparse: 1.0,
    quantised: 0.2,
}


def judge(rigd, folder, kind, trial, seed):
    """(outcome, score, what to say of it) of one sweep."""
    scene = Scene(np.random.default_rng([seed, list(KINDS).index(kind), trial]))
    f, z = kind(scene)
    path = Path(folder) / f"{kind.__name__}-{trial}.csv"
    rows = (f"{a:.6f},{b.real:.9e},{b.imag:.9e}" for a, b in zip(f, z))
    if kind is quantised:
        rows = (f"{a:.6f},{abs(b):.9e},{np.degrees(np.angle(b)):.6f}" for a, b in zip(f, z))
    names = "impedance_magnitude_ohm,phase_deg" if kind is quantised else "resistance_ohm,reactance_ohm"
    if kind is drift_one_way:
        names += ",time_s,settle_s,integration_s"
        rows = (f"{row},{second},0.9,0.1" for second, row in enumerate(rows))
    path.write_text(f"frequency_hz,{names}\n" + "\n".join(rows) + "\n")
    done = subprocess.run([rigd, "fit", str(path), "--json"], capture_output=True, text=True)
    what = f"{path.name}: fs {scene.fs:.4f} Q {scene.q:.1f} k² {scene.k2:.4f} noise {scene.noise:.4f}"
    if done.returncode not in (ACCEPTED, REFUSED):
        raise SystemExit(f"exit {done.returncode} of {what}: {done.stderr}")
    answer = json.loads(done.stdout)
    if answer["status"] == "refused":
        return "refused", 0.0, f"{what}: {answer['reason']}"
    exists = kind is not none and kind is not beyond
    truth = scene.at(answer["effective_time_s"]) if kind is drift_one_way else scene.fs
    score = (answer["resonance_hz"] - truth) / answer["sigma_hz"]
    right = exists and abs(score) <= SIGMAS
    return ("right" if right else "wrong"), score, f"{what}: {answer['resonance_hz']:.4f}, {score:+.1f} sigma"


def main():
    rigd = sys.argv[1]
    trials = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    failed = False
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(4) as pool:
        for kind, may_be_refused in KINDS.items():
            results = list(pool.map(lambda t: judge(rigd, folder, kind, t, seed), range(trials)))
            count = {name: sum(r[0] == name for r in results) for name in ("right", "refused", "wrong")}
            scores = np.array([r[1] for r in results if r[0] == "right"])
            rms = np.sqrt(np.mean(scores**2)) if len(scores) else float("nan")
            line = ", ".join(f"{n} {c}" for c, n in count.items())
            print(f"{kind.__name__:22} {line}; rms of error/sigma {rms:.2f}")
            for outcome, _, what in results:
                if outcome == "wrong" or (outcome == "refused" and may_be_refused < 0.02):
                    print("   ", outcome, what)
            # A standard deviation that is too large would refuse nothing and be wrong nowhere.
            if kind in (nominal, settled_in_time) and not 0.6 < rms < 1.4:
                print(f"    the errors of {kind.__name__} do not have the stated standard deviations")
                failed = True
            failed |= count["wrong"] > 0 or count["refused"] > max(may_be_refused, 1.5 / trials) * trials
    sys.exit("a sweep was silently wrong, or a good one refused" if failed else 0)


main()
