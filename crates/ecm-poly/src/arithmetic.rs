//! Multiply-add with two roundings, or fused with one where the machine has the instruction.

use ecm_se3::Real;

/// How a b + c is rounded.
pub trait Arithmetic<R>: Copy {
    /// a b + c.
    fn mul_add(a: R, b: R, c: R) -> R;

    /// Separates parts of a long sum for the compiler, where loading later coefficients early would
    /// push sums out of registers. Does nothing by default.
    #[inline(always)]
    fn separate() {}
}

/// Two roundings, on any machine.
#[derive(Clone, Copy, Debug)]
pub struct Plain;

impl<R: Real> Arithmetic<R> for Plain {
    #[inline(always)]
    fn mul_add(a: R, b: R, c: R) -> R {
        a * b + c
    }
}

/// One rounding. Fast only in code that is compiled for a machine with the instruction.
#[cfg(feature = "std")]
#[derive(Clone, Copy, Debug)]
pub struct Fused;

#[cfg(feature = "std")]
impl Arithmetic<f64> for Fused {
    #[inline(always)]
    fn mul_add(a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

#[cfg(feature = "std")]
impl Arithmetic<f32> for Fused {
    #[inline(always)]
    fn mul_add(a: f32, b: f32, c: f32) -> f32 {
        a.mul_add(b, c)
    }

    // In single precision all sums of a cubic and its slopes fit into registers.
    #[inline(always)]
    fn separate() {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
    }
}

/// Work that is compiled twice: for any machine, and for machines with AVX2 and FMA.
#[cfg(feature = "alloc")]
pub trait Task: Sized {
    /// Result of the work.
    type Output;
    /// Does the work. It and all that it calls must be `#[inline(always)]`.
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output;
}

/// Runs a task with AVX2 and FMA where this machine has them, which only std can ask.
#[cfg(feature = "alloc")]
#[inline]
pub fn dispatch<T: Task>(task: T) -> T::Output {
    #[cfg(all(feature = "std", target_arch = "x86_64"))]
    if let Some(machine) = pulp::x86::V3::try_new() {
        return machine.vectorize(WithFma(task));
    }
    task.run::<Plain>()
}

#[cfg(all(feature = "std", target_arch = "x86_64"))]
struct WithFma<T>(T);

#[cfg(all(feature = "std", target_arch = "x86_64"))]
impl<T: Task> pulp::NullaryFnOnce for WithFma<T> {
    type Output = T::Output;
    #[inline(always)]
    fn call(self) -> T::Output {
        self.0.run::<Fused>()
    }
}
