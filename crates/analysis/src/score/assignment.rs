//! The best one-to-one matching of rows to columns.

/// The column matched to each row of `counts` in the matching with the largest sum. With fewer columns
/// than rows some rows have `None`.
///
/// Every row must have `columns` entries. The choice among equal matchings depends on the counts
/// only.
///
/// # Source
/// The Hungarian method with potentials, O(n³): Jonker and Volgenant 1987, Computing 38, 325–340,
/// in the short form that adds one row at a time by a shortest augmenting path.
pub(super) fn best_assignment(counts: &[Vec<u32>], columns: usize) -> Vec<Option<usize>> {
    let rows = counts.len();
    let size = rows.max(columns);
    // The costs form a square; missing rows and columns cost nothing.
    let cost = |row: usize, column: usize| -> i64 {
        counts.get(row).and_then(|row| row.get(column)).map_or(0, |&count| -i64::from(count))
    };
    let mut of_row = vec![0_i64; size];
    // One extra column holds the row that is being added.
    let mut of_column = vec![0_i64; size + 1];
    let mut row_in: Vec<Option<usize>> = vec![None; size + 1];
    for added in 0..size {
        row_in[size] = Some(added);
        let mut distance = vec![i64::MAX; size];
        let mut came_from = vec![size; size];
        let mut is_reached = vec![false; size + 1];
        let mut at = size;
        while let Some(row) = row_in[at] {
            is_reached[at] = true;
            let mut nearest: Option<usize> = None;
            for column in (0..size).filter(|&column| !is_reached[column]) {
                let reduced = cost(row, column) - of_row[row] - of_column[column];
                if reduced < distance[column] {
                    distance[column] = reduced;
                    came_from[column] = at;
                }
                if nearest.is_none_or(|nearest| distance[column] < distance[nearest]) {
                    nearest = Some(column);
                }
            }
            let nearest = nearest.expect("as many columns as rows: one is still free");
            let step = distance[nearest];
            for column in 0..=size {
                if is_reached[column] {
                    of_row[row_in[column].expect("reached through its row")] += step;
                    of_column[column] -= step;
                } else {
                    distance[column] -= step;
                }
            }
            at = nearest;
        }
        while at != size {
            row_in[at] = row_in[came_from[at]];
            at = came_from[at];
        }
    }
    let mut matched = vec![None; rows];
    for (column, row) in row_in.into_iter().enumerate().take(columns) {
        if let Some(row) = row.filter(|&row| row < rows) {
            matched[row] = Some(column);
        }
    }
    matched
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The largest sum over all matchings.
    fn by_trying_all(counts: &[Vec<u32>], free: &[usize]) -> u32 {
        let Some((row, others)) = counts.split_first() else { return 0 };
        let with = |&column: &usize| {
            let rest: Vec<usize> = free.iter().copied().filter(|&other| other != column).collect();
            row[column] + by_trying_all(others, &rest)
        };
        // A row may stay without a column.
        free.iter().map(with).chain([by_trying_all(others, free)]).max().unwrap_or(0)
    }

    proptest! {
        #[test]
        fn no_other_matching_agrees_more(
            columns in 1..6_usize,
            rows in 1..6_usize,
            numbers in prop::collection::vec(0..20_u32, 25),
        ) {
            let row = |row| numbers[row * 5..row * 5 + columns].to_vec();
            let counts: Vec<Vec<u32>> = (0..rows).map(row).collect();
            let matched = best_assignment(&counts, columns);
            let mut used: Vec<usize> = matched.iter().flatten().copied().collect();
            prop_assert_eq!(used.len(), rows.min(columns));
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), rows.min(columns));
            let sum: u32 = counts
                .iter()
                .zip(&matched)
                .filter_map(|(row, column)| column.map(|column| row[column]))
                .sum();
            let all: Vec<usize> = (0..columns).collect();
            prop_assert_eq!(sum, by_trying_all(&counts, &all));
        }
    }
}
