//! Compact binary form of an energy, for targets without an allocator.
//!
//! Numbers are little-endian:
//!
//! | bytes | what |
//! |---|---|
//! | 4 | `ECMB` |
//! | 1, 1, 1, 1 | version 1; bytes of a weight, 4 or 8; symmetry 0 alike, 1 revolution, 2 general; 0 |
//! | 8 | undeformed length (m), f64 |
//! | 8, 8 | squares of the largest \|c\| (m) and \|θ\| (rad) of the training data, f64 |
//! | 2, 2 | number n of products, number e of entries |
//! | 3 n | products: monomial (u16), variable (u8) |
//! | 56 | end of the entries of each of the 28 rows, u16 |
//! | 2 e | monomial of each entry, u16 |
//! | 4 e or 8 e | weight of each entry, f32 or f64 |
//! | 4 | CRC-32 (IEEE) of all bytes before |

use core::fmt;

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Real, Wrench};

use crate::arithmetic::Plain;
use crate::energy::invariants::Symmetry;
use crate::energy::plan::{EnergyPlan, ROWS};
use crate::shape::ShapeError;

const MAGIC: &[u8; 4] = b"ECMB";
const VERSION: u8 = 1;
const HEAD: usize = 36;

/// Why bytes are no energy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum BinaryError {
    /// Fewer or more bytes than the head states.
    Length {
        /// Bytes given.
        found: usize,
        /// Bytes that the head states, or the length of the head.
        expected: usize,
    },
    /// The bytes do not begin with `ECMB`.
    Format,
    /// A version that this crate does not read.
    Version(u8),
    /// A byte of the head that has no meaning.
    Head,
    /// The checksum is another: the bytes were changed on their way.
    Sum,
    /// More monomials or entries than the memory holds.
    Memory {
        /// `monomials` (S) or `entries` (E).
        name: &'static str,
        /// Number in the bytes.
        found: usize,
        /// Number that the memory holds.
        limit: usize,
    },
    /// A number that is not finite, or a length that is not above 0.
    Number,
    /// Tables that do not fit together.
    Tables(ShapeError),
}

impl fmt::Display for BinaryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length { found, expected } => {
                write!(f, "{found} bytes, expected {expected}: copy the whole file")
            }
            Self::Format => f.write_str("no energy in binary form: it begins with ECMB"),
            Self::Version(found) => {
                write!(
                    f,
                    "version {found}, expected {VERSION}: write the bytes again"
                )
            }
            Self::Head => f.write_str("the head of the bytes has no meaning: write them again"),
            Self::Sum => f.write_str("the checksum is wrong: copy the file again"),
            Self::Memory { name, found, limit } => {
                write!(
                    f,
                    "{found} {name}, the memory holds {limit}: choose a larger one"
                )
            }
            Self::Number => f.write_str("a number is not finite, or the length is not above 0"),
            Self::Tables(error) => write!(f, "{error}"),
        }
    }
}

impl core::error::Error for BinaryError {}

/// An energy read from bytes into memory of fixed size, without allocation.
///
/// `S`: memory for the monomials, a power of two; `E`: memory for the entries. Of
/// [`Symmetry::Alike`], degree 4 takes 32 and 84, degree 6 takes 128 and 345; a refusal says how many.
///
/// ```
/// # #[cfg(feature = "std")] {
/// use ecm_poly::energy::binary::EnergyMemory;
/// use ecm_poly::{EnergyModel, Pose, Symmetry};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// // On the computer: a spring along the axis, U = 250 N/m c_x².
/// let coefficients = [0.0, 250.0, 0.0, 0.0, 0.0];
/// let model = EnergyModel::from_coefficients(0.1, 2, Symmetry::Alike, [0.02, 1.0], &coefficients)?;
/// let bytes = model.to_bytes::<f32>()?;
/// // In the firmware: `include_bytes!`, or what came over the bus.
/// let spring = EnergyMemory::<f32, 16, 64>::from_bytes(&bytes)?;
/// let pose = Pose::from_array(&[0.102, 0.0, 0.0, 0.0, 0.0, 0.0])?;
/// let (h, k) = spring.wrench_and_stiffness(&pose);
/// assert!((h.force[0] - 2500.0).abs() < 1.0 && spring.inside(&pose));
/// # assert!(k[0][0] > 0.0);
/// # Ok(()) }
/// # main().unwrap();
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct EnergyMemory<R, const S: usize, const E: usize> {
    symmetry: Symmetry,
    length_m: R,
    reach_squared: [R; 2],
    products: [(u16, u8); S],
    ends: [u16; ROWS],
    columns: [u16; E],
    weights: [R; E],
    used: (usize, usize),
}

impl<R: Real, const S: usize, const E: usize> EnergyMemory<R, S, E> {
    /// From the bytes of `EnergyModel::to_bytes`; weights of the other precision are converted.
    ///
    /// # Errors
    /// Bytes that are cut, changed, of another version, or that need more memory.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BinaryError> {
        let parts = Parts::new(bytes)?;
        let used = (parts.products.len() / 3, parts.columns.len() / 2);
        for (name, found, limit) in [("monomials", used.0 + 1, S), ("entries", used.1, E)] {
            if found > limit {
                return Err(BinaryError::Memory { name, found, limit });
            }
        }
        let mut memory = Self {
            symmetry: parts.symmetry,
            length_m: R::from_f64(parts.length_m),
            reach_squared: parts.reach_squared.map(R::from_f64),
            products: [(0, 0); S],
            ends: parts.ends(),
            columns: [0; E],
            weights: [R::ZERO; E],
            used,
        };
        memory
            .products
            .iter_mut()
            .zip(parts.products())
            .for_each(|(to, from)| *to = from);
        memory
            .columns
            .iter_mut()
            .zip(parts.columns())
            .for_each(|(to, from)| *to = from);
        memory
            .weights
            .iter_mut()
            .zip(parts.weights())
            .for_each(|(to, from)| *to = from);
        let numbers = [memory.length_m].into_iter().chain(memory.reach_squared);
        let mut numbers = numbers.chain(memory.weights.iter().copied());
        if !numbers.all(R::is_finite) || memory.length_m <= R::ZERO {
            return Err(BinaryError::Number);
        }
        let (products, columns, weights) = memory.tables();
        let (symmetry, length_m, ends) = (memory.symmetry, memory.length_m, memory.ends);
        EnergyPlan::<R, S>::new(symmetry, length_m, products, ends, columns, weights)
            .map_err(BinaryError::Tables)?;
        Ok(memory)
    }

    fn tables(&self) -> (&[(u16, u8)], &[u16], &[R]) {
        let (products, entries) = self.used;
        (
            self.products.get(..products).unwrap_or_default(),
            self.columns.get(..entries).unwrap_or_default(),
            self.weights.get(..entries).unwrap_or_default(),
        )
    }

    /// The tables as a plan, which has every evaluation.
    #[inline(always)]
    pub fn plan(&self) -> EnergyPlan<'_, R, S> {
        let (products, columns, weights) = self.tables();
        EnergyPlan::of_checked(
            self.symmetry,
            self.length_m,
            products,
            self.ends,
            columns,
            weights,
        )
    }

    /// h (N, N m) of a pose.
    pub fn wrench(&self, pose: &Pose<R>) -> Wrench<R> {
        self.plan().wrench::<Plain>(pose)
    }

    /// h (N, N m) and K = ∂h/∂p of a pose.
    pub fn wrench_and_stiffness(&self, pose: &Pose<R>) -> (Wrench<R>, Mat6<R>) {
        self.plan()
            .wrench_and_stiffness::<Plain>(pose, StiffnessKind::Partial)
    }

    /// Whether |c| and |θ| of the mid frame are at most 1.01 times those of the training data.
    pub fn inside(&self, pose: &Pose<R>) -> bool {
        let [x, y, z, a, b, c] = MidFrame::new(pose, self.length_m).coordinates();
        let [length, angle] = self.reach_squared;
        x * x + y * y + z * z <= length && a * a + b * b + c * c <= angle
    }
}

/// Sections of bytes whose length and checksum are right.
pub(crate) struct Parts<'a> {
    pub(crate) symmetry: Symmetry,
    pub(crate) length_m: f64,
    reach_squared: [f64; 2],
    products: &'a [u8],
    ends: &'a [u8],
    columns: &'a [u8],
    weights: &'a [u8],
    single: bool,
}

impl<'a> Parts<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Result<Self, BinaryError> {
        let found = bytes.len();
        let length = |expected| BinaryError::Length { found, expected };
        let (magic, _) = bytes.split_first_chunk::<4>().ok_or(length(HEAD))?;
        if magic != MAGIC {
            return Err(BinaryError::Format);
        }
        let (head, rest) = bytes.split_first_chunk::<HEAD>().ok_or(length(HEAD))?;
        let [_, _, _, _, version, size, symmetry, spare, ..] = *head;
        if version != VERSION {
            return Err(BinaryError::Version(version));
        }
        let symmetry = match symmetry {
            0 => Symmetry::Alike,
            1 => Symmetry::Revolution,
            2 => Symmetry::General,
            _ => return Err(BinaryError::Head),
        };
        if spare != 0 || !matches!(size, 4 | 8) {
            return Err(BinaryError::Head);
        }
        let count = |at: usize| {
            let two = head.get(at..at + 2).unwrap_or_default();
            words(two).next().map_or(0, usize::from)
        };
        let (n, e) = (count(32), count(34));
        let sizes = [3 * n, 2 * ROWS, 2 * e, usize::from(size) * e, 4];
        let expected = HEAD + sizes.iter().sum::<usize>();
        if found != expected {
            return Err(length(expected));
        }
        let mut rest = rest;
        let [products, ends, columns, weights, sum] = sizes.map(|size| {
            let (part, after) = rest.split_at_checked(size).unwrap_or_default();
            rest = after;
            part
        });
        let before = bytes.get(..expected - 4).unwrap_or_default();
        if sum != crc32(before).to_le_bytes() {
            return Err(BinaryError::Sum);
        }
        let mut doubles = doubles(head.get(8..32).unwrap_or_default());
        let mut double = || doubles.next().unwrap_or(f64::NAN);
        Ok(Self {
            symmetry,
            length_m: double(),
            reach_squared: [double(), double()],
            products,
            ends,
            columns,
            weights,
            single: size == 4,
        })
    }

    pub(crate) fn ends(&self) -> [u16; ROWS] {
        let mut ends = words(self.ends);
        core::array::from_fn(|_| ends.next().unwrap_or(0))
    }

    pub(crate) fn products(&self) -> impl Iterator<Item = (u16, u8)> + 'a {
        let (products, _) = self.products.as_chunks::<3>();
        products
            .iter()
            .map(|&[low, high, variable]| (u16::from_le_bytes([low, high]), variable))
    }

    pub(crate) fn columns(&self) -> impl Iterator<Item = u16> + 'a {
        words(self.columns)
    }

    pub(crate) fn weights<R: Real>(&self) -> impl Iterator<Item = R> + 'a {
        let (single, double) = if self.single {
            (self.weights, Default::default())
        } else {
            (Default::default(), self.weights)
        };
        let single = single.as_chunks::<4>().0.iter();
        let single = single.map(|&four| R::from_f64(f64::from(f32::from_le_bytes(four))));
        single.chain(doubles(double).map(R::from_f64))
    }
}

fn words(bytes: &[u8]) -> impl Iterator<Item = u16> + '_ {
    bytes
        .as_chunks::<2>()
        .0
        .iter()
        .map(|&two| u16::from_le_bytes(two))
}

fn doubles(bytes: &[u8]) -> impl Iterator<Item = f64> + '_ {
    bytes
        .as_chunks::<8>()
        .0
        .iter()
        .map(|&eight| f64::from_le_bytes(eight))
}

/// CRC-32 (IEEE 802.3), bit by bit: read once, no table.
pub(crate) fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ (0xEDB8_8320 & (sum & 1).wrapping_neg())
        })
    })
}

/// The head up to the numbers of products and entries.
#[cfg(feature = "alloc")]
pub(crate) fn head(
    single: bool,
    symmetry: Symmetry,
    length_m: f64,
    reach_squared: [f64; 2],
    counts: [u16; 2],
) -> [u8; HEAD] {
    let symmetry = match symmetry {
        Symmetry::Alike => 0,
        Symmetry::Revolution => 1,
        Symmetry::General => 2,
    };
    let mut bytes = [0; HEAD];
    let marks = [VERSION, if single { 4 } else { 8 }, symmetry, 0];
    let numbers = [length_m, reach_squared[0], reach_squared[1]];
    let all = MAGIC
        .iter()
        .copied()
        .chain(marks)
        .chain(numbers.into_iter().flat_map(f64::to_le_bytes))
        .chain(counts.into_iter().flat_map(u16::to_le_bytes));
    bytes.iter_mut().zip(all).for_each(|(to, from)| *to = from);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_standard() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
    }
}
