//! How a product and a sum are rounded: apart, or at once where the machine can.

use ecm_se3::Real;

/// a b + c.
pub trait Arithmetic<R>: Copy {
    /// a b + c.
    fn mul_add(a: R, b: R, c: R) -> R;

    /// Between parts of a long sum: what follows is not loaded ahead where that pushes sums out of
    /// registers. Nothing by default.
    #[inline(always)]
    fn part() {}
}

/// Two roundings: what every machine can.
#[derive(Clone, Copy, Debug)]
pub struct Plain;

impl<R: Real> Arithmetic<R> for Plain {
    #[inline(always)]
    fn mul_add(a: R, b: R, c: R) -> R {
        a * b + c
    }
}

/// One rounding: fast only in code that is compiled for a machine with the instruction.
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

    // All sums of a cubic and its slopes fit into registers, which in double precision they do not.
    #[inline(always)]
    fn part() {
        core::sync::atomic::compiler_fence(core::sync::atomic::Ordering::SeqCst);
    }
}

/// Work that is compiled twice: for any machine, and for one with AVX2 and FMA.
#[cfg(feature = "std")]
pub trait Task: Sized {
    /// What it returns.
    type Output;
    /// The work; implementations are `#[inline(always)]`, all the way down.
    fn run<A: Arithmetic<f64> + Arithmetic<f32>>(self) -> Self::Output;
}

/// Runs a task with AVX2 and FMA where this machine has them.
#[cfg(feature = "std")]
#[inline]
pub fn dispatch<T: Task>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
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
