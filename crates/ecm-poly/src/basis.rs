//! Monomials by degree, then in the order of the paper's eq. (4): 1, x, y, …, x², xy, …, z², x³, x²y, …

/// k = C(d + n, d), the number of monomials of `inputs` variables up to `degree`.
///
/// `None` where it does not fit into `usize`.
pub const fn number_of_terms(inputs: usize, degree: usize) -> Option<usize> {
    // C(d + n, d) is C(d + n, n): the fewer factors end at once, whatever the other number.
    let (few, many) = if inputs < degree {
        (inputs, degree)
    } else {
        (degree, inputs)
    };
    let mut k: usize = 1;
    let mut i = 1;
    while i <= few {
        // C(n + i, i) = C(n + i − 1, i − 1) (n + i) / i, exact at every step.
        let Some(factor) = many.checked_add(i) else {
            return None;
        };
        k = match k.checked_mul(factor) {
            Some(product) => product / i,
            None => return None,
        };
        i += 1;
    }
    Some(k)
}

/// Turns the exponents of one monomial into those of the next one.
///
/// Within a degree the order is lexicographic with the first variable's power falling;
/// after the last monomial of a degree comes the first of the next degree.
pub fn advance(exponents: &mut [u8]) {
    let Some(last) = exponents.len().checked_sub(1) else {
        return;
    };
    let tail = exponents[last];
    exponents[last] = 0;
    match exponents[..last].iter().rposition(|&e| e > 0) {
        Some(i) => {
            exponents[i] -= 1;
            exponents[i + 1] = tail.saturating_add(1);
        }
        None => exponents[0] = tail.saturating_add(1),
    }
}

/// Exponents of all monomials up to `degree`, one row of `inputs` numbers each.
///
/// # Errors
/// No inputs or more than 255, a degree above 20, or more than a million terms.
///
/// ```
/// # fn main() -> Result<(), ecm_poly::ModelError> {
/// // 1, x, y, x², xy, y²
/// let rows = ecm_poly::basis::exponents(2, 2)?;
/// assert_eq!(rows, [0, 0, 1, 0, 0, 1, 2, 0, 1, 1, 0, 2]);
/// # Ok(()) }
/// ```
#[cfg(feature = "alloc")]
pub fn exponents(inputs: usize, degree: usize) -> Result<alloc::vec::Vec<u8>, crate::ModelError> {
    use crate::error::ModelError;

    if inputs == 0 || inputs > 255 || degree > 20 {
        return Err(ModelError::Setting {
            name: "degree",
            found: alloc::format!("{degree} of {inputs} inputs"),
            expected: "1 to 255 inputs and a degree of at most 20",
        });
    }
    let k = number_of_terms(inputs, degree)
        .filter(|&k| k <= 1_000_000 && k * inputs <= 20_000_000)
        .ok_or_else(|| ModelError::Setting {
            name: "degree",
            found: alloc::format!("degree {degree} of {inputs} inputs"),
            expected: "at most a million terms: take a lower degree",
        })?;
    let mut current = alloc::vec![0; inputs];
    let mut table = alloc::vec::Vec::with_capacity(k * inputs);
    for _ in 0..k {
        table.extend_from_slice(&current);
        advance(&mut current);
    }
    Ok(table)
}

#[cfg(all(test, feature = "std"))]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn counts_of_the_paper() {
        assert_eq!(number_of_terms(6, 1), Some(7));
        assert_eq!(number_of_terms(6, 2), Some(28));
        assert_eq!(number_of_terms(6, 3), Some(84));
        assert_eq!(number_of_terms(usize::MAX / 2, 5), None);
    }

    #[test]
    fn order_of_equation_4() {
        let names = |row: &[u8]| {
            let mut text = std::string::String::new();
            for (name, &e) in ["x", "y", "z"].iter().zip(row) {
                text.push_str(&name.repeat(usize::from(e)));
            }
            text
        };
        let table = exponents(3, 3).unwrap();
        let found: alloc::vec::Vec<_> = table.chunks(3).map(names).collect();
        assert_eq!(
            found.join(" "),
            " x y z xx xy xz yy yz zz xxx xxy xxz xyy xyz xzz yyy yyz yzz zzz"
        );
    }

    proptest! {
        #[test]
        fn every_monomial_once_in_order(inputs in 1usize..7, degree in 0usize..6) {
            let table = exponents(inputs, degree).unwrap();
            let rows: alloc::vec::Vec<&[u8]> = table.chunks(inputs).collect();
            prop_assert_eq!(rows.len(), number_of_terms(inputs, degree).unwrap());
            let total = |row: &[u8]| row.iter().map(|&e| u32::from(e)).sum::<u32>();
            for pair in rows.windows(2) {
                let (a, b) = (total(pair[0]), total(pair[1]));
                prop_assert!(a < b || (a == b && pair[0] > pair[1]));
            }
            prop_assert!(rows.iter().all(|row| total(row) as usize <= degree));
        }
    }
}
