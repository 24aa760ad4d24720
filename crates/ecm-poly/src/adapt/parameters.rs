//! The parameters that may be estimated, what is known of each, and the noise of the instruments.

use ecm_se3::linear::{apply, cross};
use ecm_se3::{Mat3, Real, Vec3, Vec6};

use crate::stepper::BRANCHES;

/// Ranges from the middle at which the error stops to grow, so that all stays finite.
const FARTHEST: u16 = 4;

/// A named parameter. The measured wrench is linear in all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Parameter {
    /// s (1): factor on the whole wrench of the model.
    Modulus,
    /// m (kg): mass that hangs on the platform.
    Mass,
    /// m c_x (kg m), c the centre of this mass in the platform's frame.
    MassX,
    /// m c_y (kg m).
    MassY,
    /// m c_z (kg m).
    MassZ,
    /// b_fx (N): zero of the sensor, constant in the platform's frame.
    ZeroFx,
    /// b_fy (N).
    ZeroFy,
    /// b_fz (N).
    ZeroFz,
    /// b_τx (N m).
    ZeroTx,
    /// b_τy (N m).
    ZeroTy,
    /// b_τz (N m).
    ZeroTz,
    /// g_1 (1): share of the first relaxing branch.
    ShareFirst,
    /// g_2 (1): share of the second.
    ShareSecond,
}

impl Parameter {
    /// All of them, in the order of their numbers.
    pub const ALL: [Parameter; 13] = [
        Parameter::Modulus,
        Parameter::Mass,
        Parameter::MassX,
        Parameter::MassY,
        Parameter::MassZ,
        Parameter::ZeroFx,
        Parameter::ZeroFy,
        Parameter::ZeroFz,
        Parameter::ZeroTx,
        Parameter::ZeroTy,
        Parameter::ZeroTz,
        Parameter::ShareFirst,
        Parameter::ShareSecond,
    ];

    /// The name in files and in Python.
    pub const fn name(self) -> &'static str {
        match self {
            Parameter::Modulus => "modulus",
            Parameter::Mass => "mass",
            Parameter::MassX => "mass_x",
            Parameter::MassY => "mass_y",
            Parameter::MassZ => "mass_z",
            Parameter::ZeroFx => "zero_fx",
            Parameter::ZeroFy => "zero_fy",
            Parameter::ZeroFz => "zero_fz",
            Parameter::ZeroTx => "zero_tau_x",
            Parameter::ZeroTy => "zero_tau_y",
            Parameter::ZeroTz => "zero_tau_z",
            Parameter::ShareFirst => "share_first",
            Parameter::ShareSecond => "share_second",
        }
    }

    /// Whether it belongs to the sensor, so that the robot does not feel it.
    pub const fn is_zero(self) -> bool {
        let number = self as u8;
        number >= Parameter::ZeroFx as u8 && number <= Parameter::ZeroTz as u8
    }

    /// Whether its column carries the noise of the measured pose.
    pub(crate) const fn follows_model(self) -> bool {
        self as u8 == Parameter::Modulus as u8 || self as u8 >= Parameter::ShareFirst as u8
    }

    /// ∂(measured wrench)/∂(parameter).
    pub(crate) fn column<R: Real>(
        self,
        base_from_top: &Mat3<R>,
        gravity: &Vec3<R>,
        predicted: &Vec6<R>,
        branches: &[Vec6<R>; BRANCHES],
    ) -> Vec6<R> {
        let mut column = [R::ZERO; 6];
        match self {
            Parameter::Modulus => return *predicted,
            Parameter::ShareFirst => return branches[0],
            Parameter::ShareSecond => return branches[1],
            Parameter::Mass => {
                for (c, g) in column.iter_mut().zip(gravity) {
                    *c = -*g;
                }
            }
            Parameter::MassX | Parameter::MassY | Parameter::MassZ => {
                let axis = self as usize - Parameter::MassX as usize;
                let arm = base_from_top.map(|row| row[axis]);
                let torque = cross(gravity, &arm);
                column[3..].copy_from_slice(&torque);
            }
            _ => {
                let axis = self as usize - Parameter::ZeroFx as usize;
                let mut unit = [R::ZERO; 3];
                unit[axis % 3] = R::ONE;
                let turned = apply(base_from_top, &unit);
                for (c, t) in column.iter_mut().skip(axis - axis % 3).zip(&turned) {
                    *c = *t;
                }
            }
        }
        column
    }
}

/// What is known of a parameter before and between readings.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Prior<R> {
    /// Value at the start; of a share the one that the model has.
    pub start: R,
    /// Standard deviation at the start, which is also the largest; 0 holds the parameter.
    pub sd: R,
    /// Least value.
    pub low: R,
    /// Largest value.
    pub high: R,
    /// Standard deviation of its change in an hour.
    pub walk: R,
    /// 1: it may jump, as a load that is put on; 0: it only drifts.
    pub jumps: R,
}

/// Noise of the readings, and error of the model.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Noise<R> {
    /// Standard deviation of one reading of the wrench: force (N) and torque (N m).
    pub wrench: [R; 2],
    /// The same of the pose: position (m) and rotation (rad).
    pub pose: [R; 2],
    /// Time (s) over which noise stays alike, such as a camera's period; 0: white.
    pub time_s: R,
    /// Error of the model itself, beside its parameters: force (N) and torque (N m).
    pub model: [R; 2],
    /// Way (m, rad) over which the error of the model changes.
    pub reach: [R; 2],
    /// Its error at the rim of the fitted domain over that in the middle, 1 or more.
    pub rim: R,
    /// Middle of the fitted domain (m, rad).
    pub middle: Vec6<R>,
    /// One over half the range of each coordinate (1/m, 1/rad); 0: it has no rim.
    pub per_half_range: Vec6<R>,
}

impl<R: Real> Noise<R> {
    /// 1 + (rim − 1) q⁶: the error at a pose over that in the middle, with q = 1 at the rim. It grows so
    /// outside as well, as a polynomial does that nothing holds there.
    pub(super) fn away_from_middle(&self, pose: &Vec6<R>) -> R {
        let mut q = R::ZERO;
        for i in 0..6 {
            let part = (pose[i] - self.middle[i]) * self.per_half_range[i];
            let part = if part < R::ZERO { -part } else { part };
            if part > q {
                q = part;
            }
        }
        let far = R::from_u16(FARTHEST);
        let q = if q < far { q } else { far };
        let cube = q * q * q;
        R::ONE + (self.rim - R::ONE) * (cube * cube)
    }
}
