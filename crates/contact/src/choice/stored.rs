//! The errors of every tier for the reference sensor, Hz, as a test of this crate measures them.

use super::ErrorTable;

/// Marks contacts that the tier refuses.
const NEVER: f64 = f64::INFINITY;

/// Per tier and control: a row for each largest tilt, a column for each largest stiffness ratio.
#[rustfmt::skip]
pub(super) const REFERENCE: ErrorTable = ErrorTable([
    // T0: indentation, then stage.
    [
        [
            [3.882, 6.427, 6.427, 11.418, NEVER],
            [4.281, 7.559, 7.559, 16.767, NEVER],
            [4.281, 7.559, 8.047, 23.146, NEVER],
            [4.281, 7.559, 12.177, 27.547, NEVER],
        ],
        [
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
        ],
    ],
    // T0b: indentation, then stage.
    [
        [
            [3.008, 3.932, 3.932, 3.932, NEVER],
            [4.047, 6.698, 6.698, 6.698, NEVER],
            [5.298, 10.430, 12.106, 12.106, NEVER],
            [6.237, 13.623, 17.614, 19.761, NEVER],
        ],
        [
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
        ],
    ],
    // T1: indentation, then stage.
    [
        [
            [0.179, 0.297, 0.297, 0.506, 7.024],
            [0.881, 2.589, 4.368, 6.298, 16.354],
            [2.195, 6.273, 10.194, 14.075, 30.352],
            [3.262, 9.392, 15.277, 21.021, 43.798],
        ],
        [
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
        ],
    ],
    // T2: indentation, then stage.
    [
        [
            [0.179, 0.297, 0.297, 0.506, 7.024],
            [0.184, 0.377, 0.386, 1.174, 10.303],
            [0.184, 0.389, 0.554, 1.708, 12.643],
            [0.184, 0.389, 0.635, 1.823, 12.987],
        ],
        [
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
        ],
    ],
    // T2s: indentation, then stage.
    [
        [
            [0.179, 0.297, 0.297, 0.506, 7.024],
            [0.184, 0.377, 0.386, 1.174, 10.303],
            [0.184, 0.389, 0.554, 1.708, 12.643],
            [0.184, 0.389, 0.635, 1.823, 12.987],
        ],
        [
            [0.172, 0.299, 0.299, 0.299, 2.381],
            [0.178, 0.364, 0.389, 0.433, 3.681],
            [0.178, 0.375, 0.431, 0.784, 4.823],
            [0.178, 0.375, 0.431, 0.938, 5.290],
        ],
    ],
    // E1: indentation, then stage.
    [
        [
            [0.025, 0.094, 0.199, 0.351, 1.694],
            [0.026, 0.096, 0.202, 0.358, 1.740],
            [0.026, 0.096, 0.202, 0.358, 1.740],
            [0.026, 0.096, 0.202, 0.358, 1.740],
        ],
        [
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
            [NEVER, NEVER, NEVER, NEVER, NEVER],
        ],
    ],
    // E1s: indentation, then stage.
    [
        [
            [0.025, 0.094, 0.199, 0.351, 1.694],
            [0.026, 0.096, 0.202, 0.358, 1.740],
            [0.026, 0.096, 0.202, 0.358, 1.740],
            [0.026, 0.096, 0.202, 0.358, 1.740],
        ],
        [
            [0.023, 0.076, 0.145, 0.229, 0.735],
            [0.023, 0.077, 0.145, 0.230, 0.736],
            [0.023, 0.077, 0.145, 0.230, 0.736],
            [0.023, 0.077, 0.145, 0.230, 0.736],
        ],
    ],
    // exact: indentation, then stage.
    [
        [
            [0.002, 0.003, 0.006, 0.012, 0.057],
            [0.002, 0.004, 0.008, 0.016, 0.073],
            [0.002, 0.006, 0.013, 0.021, 0.080],
            [0.002, 0.006, 0.015, 0.027, 0.082],
        ],
        [
            [0.001, 0.002, 0.004, 0.008, 0.027],
            [0.001, 0.002, 0.006, 0.010, 0.034],
            [0.001, 0.004, 0.008, 0.013, 0.040],
            [0.001, 0.005, 0.011, 0.020, 0.057],
        ],
    ],
    // reference: indentation, then stage.
    [
        [
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
        ],
        [
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
            [0.000, 0.000, 0.000, 0.000, 0.000],
        ],
    ],
]);
