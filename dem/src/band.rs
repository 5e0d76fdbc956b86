//! Symmetric positive definite systems whose entries lie near the diagonal.

/// Solves A x = b in place by Cholesky's method. Row i of `band` holds the entries of the columns i - width .. i.
/// Returns `false`, with `b` spoilt, if the matrix is not positive definite.
pub(crate) fn solve(band: &mut [f64], width: usize, b: &mut [f64]) -> bool {
    let row = width + 1;
    for i in 0..b.len() {
        let first = i.saturating_sub(width);
        for j in first..=i {
            let (above, below) = band.split_at_mut(i * row);
            let from = first.max(j.saturating_sub(width));
            // Parts of the rows i and j in front of column j.
            let mine = &below[from + width - i..j + width - i];
            let known: f64 = match j == i {
                true => mine.iter().map(|x| x * x).sum(),
                false => {
                    let other = &above[j * row..][from + width - j..width];
                    mine.iter().zip(other).map(|(x, y)| x * y).sum()
                }
            };
            let rest = below[j + width - i] - known;
            if j < i {
                below[j + width - i] = rest / above[j * row + width];
            } else if rest > 0.0 {
                below[width] = rest.sqrt();
            } else {
                return false;
            }
        }
        let (before, now) = b.split_at_mut(i);
        let entries = &band[i * row + first + width - i..i * row + width];
        let known: f64 = entries.iter().zip(&before[first..]).map(|(x, y)| x * y).sum();
        now[0] = (now[0] - known) / band[i * row + width];
    }
    for i in (0..b.len()).rev() {
        b[i] /= band[i * row + width];
        let (first, value) = (i.saturating_sub(width), b[i]);
        let entries = &band[i * row + first + width - i..i * row + width];
        b[first..i].iter_mut().zip(entries).for_each(|(x, entry)| *x -= entry * value);
    }
    true
}

#[cfg(test)]
mod tests {
    /// The second difference of 1, 4, 9, .. is 2: with a band wider than needed, and of the whole matrix.
    #[test]
    fn a_banded_system_is_solved() {
        let n = 12;
        for width in [1, 3, 11] {
            let mut band = vec![0.0; n * (width + 1)];
            for i in 0..n {
                band[i * (width + 1) + width] = 2.0;
                if i > 0 {
                    band[i * (width + 1) + width - 1] = -1.0;
                }
            }
            let x: Vec<f64> = (0..n).map(|i| ((i + 1) * (i + 1)) as f64).collect();
            let at = |i: isize| if (0..n as isize).contains(&i) { x[i as usize] } else { 0.0 };
            let mut b: Vec<f64> = (0..n as isize).map(|i| 2.0 * at(i) - at(i - 1) - at(i + 1)).collect();
            assert!(super::solve(&mut band, width, &mut b));
            b.iter().zip(&x).for_each(|(b, x)| approx::assert_relative_eq!(b, x, max_relative = 1e-11));
        }
    }

    #[test]
    fn an_indefinite_matrix_is_refused() {
        assert!(!super::solve(&mut [0.0, 1.0, 2.0, 1.0], 1, &mut [1.0, 1.0]));
    }
}
