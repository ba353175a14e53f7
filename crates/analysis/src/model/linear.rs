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

/// The lower factor L of a symmetric matrix L Lᵀ, by Cholesky; `None` unless it is positive definite.
pub(super) fn cholesky(matrix: &Matrix) -> Option<Matrix> {
    let mut factor: Matrix = Vec::with_capacity(matrix.len());
    for (i, values) in matrix.iter().enumerate() {
        let mut row: Vec<f64> = Vec::with_capacity(i + 1);
        for j in 0..=i {
            let other = factor.get(j).unwrap_or(&row);
            let rest = values[j] - row.iter().zip(other).take(j).map(|(a, b)| a * b).sum::<f64>();
            let value = if j < i { rest / other[j] } else { rest.sqrt() };
            if !value.is_finite() {
                return None;
            }
            row.push(value);
        }
        factor.push(row);
    }
    Some(factor)
}

/// L⁻¹ b of a lower factor.
pub(super) fn forward(factor: &Matrix, b: &[f64]) -> Vec<f64> {
    let mut solved: Vec<f64> = Vec::with_capacity(b.len());
    for (row, b) in factor.iter().zip(b) {
        let known: f64 = row.iter().zip(&solved).map(|(a, b)| a * b).sum();
        solved.push((b - known) / row[solved.len()]);
    }
    solved
}

/// L⁻ᵀ b of a lower factor.
pub(super) fn backward(factor: &Matrix, b: &[f64]) -> Vec<f64> {
    let mut rest = b.to_vec();
    for (i, row) in factor.iter().enumerate().rev() {
        rest[i] /= row[i];
        let solved = rest[i];
        rest.iter_mut().zip(&row[..i]).for_each(|(rest, a)| *rest -= a * solved);
    }
    rest
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
    #[test]
    fn a_cholesky_factor_solves_both_ways_and_an_indefinite_matrix_has_none() {
        let matrix = vec![vec![4.0, 2.0, 1.0], vec![2.0, 5.0, 3.0], vec![1.0, 3.0, 9.0]];
        let factor = cholesky(&matrix).unwrap();
        let expected = [7.0, -2.0, 5.0];
        let product: Vec<f64> =
            (matrix.iter()).map(|row| row.iter().zip(expected).map(|(a, b)| a * b).sum()).collect();
        let solved = backward(&factor, &forward(&factor, &product));
        for (found, expected) in solved.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{solved:?}");
        }
        assert_eq!(cholesky(&vec![vec![1.0, 2.0], vec![2.0, 1.0]]), None);
    }
}
