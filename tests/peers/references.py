"""What touches have in common by their references, from the tables of a run and by the text of docs/numbers.md.

Nothing here is from rigd: each reference is written as a sum of independent errors, of its sweeps and of the steps of the walk
of the free resonance between the times that matter, and the covariance is that of these sums.
"""

import numpy as np


def covariance(touches, sweeps, readings):
    """The covariance of the shifts of these rows of touches.csv by their references, Hz², with the variance of each
    reference on the diagonal.

    `sweeps` are the rows of sweeps.csv and `readings` lists of rows of readings.csv, by the number of their sweep.
    """

    def time_s(number):
        """The time for which a sweep holds."""
        if sweeps[number]["effective_time_s"]:
            return float(sweeps[number]["effective_time_s"])
        first, last = readings[number][0], readings[number][-1]
        return (float(first["started_s"]) + float(last["started_s"])) / 2

    errors = []
    for touch in touches:
        before, after = touch["no_load_sweep"], touch["next_no_load_sweep"]
        drift_hz, error = float(touch["drift_sigma_hz"]), {}
        if not after:
            # The walk up to the touch: the variance is its clock.
            error[before] = float(touch["no_load_sigma_hz"])
            errors.append((error, before, None, (drift_hz**2, None)))
            continue
        ends = [sweeps[number] for number in (before, after)]
        resonances = [float(end["resonance_hz"]) for end in ends]
        apart = resonances[1] - resonances[0]
        begin_s, at_s, end_s = time_s(before), time_s(touch["sweep"]), time_s(after)
        since_s, whole_s = at_s - begin_s, end_s - begin_s
        weight = (float(touch["no_load_hz"]) - resonances[0]) / apart if apart else since_s / whole_s
        error[before] = (1 - weight) * float(ends[0]["sigma_hz"])
        error[after] = weight * float(ends[1]["sigma_hz"])
        # (1 − a)² t + a² (T − t) times the variance in a second is that of the drift between both.
        per_s = drift_hz**2 / ((1 - weight) ** 2 * since_s + weight**2 * (whole_s - since_s))
        errors.append((error, before, after, (per_s, (weight, since_s, whole_s))))

    def walk(one, other):
        (_, before, after, walked), (_, other_before, other_after, other_walked) = one, other
        if (before, after) != (other_before, other_after):
            return 0.0
        if after is None:
            return min(walked[0], other_walked[0])
        # Each error is a step function over the walk: a − 1 until the touch, a from there to the second sweep.
        (a, since_s, whole_s), (b, other_since_s, _) = walked[1], other_walked[1]
        cuts = sorted({0.0, since_s, other_since_s, whole_s})
        total = sum(
            (end - begin) * (a - (begin < since_s)) * (b - (begin < other_since_s))
            for begin, end in zip(cuts, cuts[1:])
        )
        return np.sqrt(walked[0] * other_walked[0]) * total

    def of_sweeps(one, other):
        return sum(sigma_hz * other[0].get(number, 0.0) for number, sigma_hz in one[0].items())

    return np.array([[of_sweeps(one, other) + walk(one, other) for other in errors] for one in errors])
