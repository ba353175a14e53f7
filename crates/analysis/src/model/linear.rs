//! Linear algebra of a few unknowns.

/// A square matrix by rows.
pub(super) type Matrix = Vec<Vec<f64>>;

/// The inverse by elimination with pivots; `None` for a singular matrix.
pub(super) fn inverse(matrix: &Matrix) -> Option<Matrix> {
    let n = matrix.len();
    let unit = |row: usize| (0..n).map(move |column| f64::from(u8::from(column == row)));
    let mut rows: Matrix = (matrix.iter().enumerate())
        .map(|(row, values)| values.iter().copied().chain(unit(row)).collect())
        .collect();
    for column in 0..n {
        let size = |&row: &usize| rows[row][column].abs();
        let pivot = (column..n).max_by(|a, b| size(a).total_cmp(&size(b)))?;
        rows.swap(column, pivot);
        let lead = rows[column][column];
        if !(lead.is_finite() && lead.abs() > f64::MIN_POSITIVE) {
            return None;
        }
        rows[column].iter_mut().for_each(|value| *value /= lead);
        let by = rows[column].clone();
        for (_, values) in rows.iter_mut().enumerate().filter(|(row, _)| *row != column) {
            let factor = values[column];
            values.iter_mut().zip(&by).for_each(|(value, by)| *value -= factor * by);
        }
    }
    Some(rows.into_iter().map(|row| row[n..].to_vec()).collect())
}

/// aᵀ M b.
pub(super) fn form(a: &[f64], matrix: &Matrix, b: &[f64]) -> f64 {
    let row = |values: &Vec<f64>| values.iter().zip(b).map(|(value, b)| value * b).sum::<f64>();
    a.iter().zip(matrix).map(|(a, values)| a * row(values)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_times_its_inverse_is_one_and_a_singular_one_has_none() {
        let matrix = vec![vec![0.0, 2.0, 1.0], vec![2.0, 5.0, 3.0], vec![1.0, 3.0, 9.0]];
        let inverse_of = inverse(&matrix).unwrap();
        for row in 0..3 {
            for column in 0..3 {
                let unit = |at: usize| (0..3).map(|k| f64::from(u8::from(k == at))).collect();
                let (left, right): (Vec<f64>, Vec<f64>) = (unit(row), unit(column));
                let product: f64 = (0..3).map(|k| matrix[row][k] * inverse_of[k][column]).sum();
                assert!((product - f64::from(u8::from(row == column))).abs() < 1e-12);
                assert_eq!(form(&left, &matrix, &right), matrix[row][column]);
            }
        }
        assert_eq!(inverse(&vec![vec![1.0, 2.0], vec![2.0, 4.0]]), None);
        assert_eq!(inverse(&Vec::new()), Some(Vec::new()));
    }
}
