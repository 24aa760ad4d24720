//! SIMD evaluation of the plan of a body of revolution, for degrees 4 to 8.
//!
//! U = Σ_β B_β(θ_x, a, b) G_β(c_x, |c⊥|², |θ⊥|²). One lane per product B_β of powers, eight or
//! sixteen of them; Horner's rule runs over c_x inside |θ⊥|² inside |c⊥|² and
//! updates first and second derivatives, so that all lanes do the same operations at every pose.

use core::hint::black_box;

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::StiffnessKind;
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use crate::arithmetic::Arithmetic;
use crate::energy::invariants::Symmetry;
use crate::energy::plan::wrench_and_stiffness;

/// Highest power of the factor of a lane, which is the highest degree.
const MAX_POWER: usize = 8;

/// The degrees for which the loops over the powers are written out.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Levels {
    Four,
    Five,
    Six,
    Seven,
    Eight,
}

impl Levels {
    /// `None` for another degree in q.
    pub(crate) fn of_degree(degree: usize) -> Option<Self> {
        match degree {
            4 => Some(Self::Four),
            5 => Some(Self::Five),
            6 => Some(Self::Six),
            7 => Some(Self::Seven),
            8 => Some(Self::Eight),
            _ => None,
        }
    }
}

/// Borrowed `SimdTables`, which alone makes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SimdPlan<'a, R, const B: usize> {
    /// Undeformed length (m).
    pub(super) length_m: R,
    /// Powers up to the highest degree in q.
    pub(super) levels: Levels,
    /// Powers of θ_x, a and b of each lane; unused lanes have coefficients 0.
    pub(super) powers: [[u8; 3]; B],
    /// Coefficients of |c⊥|²ʲ |θ⊥|²ᵏ c_xⁿ: j falling, inside it k falling, inside it n falling,
    /// 2j + 2k + n ≤ degree.
    pub(super) coefficients: &'a [[R; B]],
}

/// G and its derivatives, one lane each: plain, and halves of the pure second ones.
struct Inner<R, const B: usize> {
    u: [R; B],
    x: [R; B],
    p: [R; B],
    t: [R; B],
    xx: [R; B],
    xp: [R; B],
    xt: [R; B],
    pp: [R; B],
    pt: [R; B],
    tt: [R; B],
}

impl<R: Real, const B: usize> Inner<R, B> {
    #[inline(always)]
    fn zero() -> Self {
        let zero = [R::ZERO; B];
        Inner {
            u: zero,
            x: zero,
            p: zero,
            t: zero,
            xx: zero,
            xp: zero,
            xt: zero,
            pp: zero,
            pt: zero,
            tt: zero,
        }
    }

    /// Self times t plus a polynomial of c_x with `COUNT` coefficients; returns those left.
    #[inline(always)]
    fn add_row<'c, A: Arithmetic<R>, const SECOND: bool, const COUNT: usize>(
        &mut self,
        coefficients: &'c [[R; B]],
        x: R,
        t: R,
    ) -> &'c [[R; B]] {
        let Some((row, rest)) = coefficients.split_first_chunk::<COUNT>() else {
            return coefficients;
        };
        let (mut w, mut w1, mut w2) = (row[0], [R::ZERO; B], [R::ZERO; B]);
        for c in &row[1..] {
            if SECOND {
                horner::<R, A, B>(&mut w2, x, &w1);
            }
            horner::<R, A, B>(&mut w1, x, &w);
            horner::<R, A, B>(&mut w, x, c);
        }
        if SECOND {
            horner::<R, A, B>(&mut self.tt, t, &self.t);
            horner::<R, A, B>(&mut self.xt, t, &self.x);
            horner::<R, A, B>(&mut self.xx, t, &w2);
        }
        horner::<R, A, B>(&mut self.t, t, &self.u);
        horner::<R, A, B>(&mut self.x, t, &w1);
        horner::<R, A, B>(&mut self.u, t, &w);
        rest
    }

    /// Self times p plus a polynomial of c_x and |θ⊥|².
    #[inline(always)]
    fn add_level<A: Arithmetic<R>, const SECOND: bool>(&mut self, level: &Self, p: R) {
        if SECOND {
            horner::<R, A, B>(&mut self.pp, p, &self.p);
            horner::<R, A, B>(&mut self.pt, p, &self.t);
            horner::<R, A, B>(&mut self.xp, p, &self.x);
            horner::<R, A, B>(&mut self.xx, p, &level.xx);
            horner::<R, A, B>(&mut self.xt, p, &level.xt);
            horner::<R, A, B>(&mut self.tt, p, &level.tt);
        }
        horner::<R, A, B>(&mut self.p, p, &self.u);
        horner::<R, A, B>(&mut self.t, p, &level.t);
        horner::<R, A, B>(&mut self.x, p, &level.x);
        horner::<R, A, B>(&mut self.u, p, &level.u);
    }
}

impl<R: Real, const B: usize> SimdPlan<'_, R, B> {
    /// U (J) at a pose.
    #[inline(always)]
    pub(crate) fn energy<A: Arithmetic<R>>(&self, pose: &Pose<R>) -> R {
        let q = MidFrame::new(pose, self.length_m).coordinates();
        let v = Symmetry::Revolution.variables(&q);
        let inner = self.inner::<A, false>(&v);
        let (theta_x, a) = (powers(v[3]), powers(v[4]));
        let mut sum = R::ZERO;
        for (l, &[ex, ea, eb]) in self.powers.iter().enumerate() {
            let b = if eb == 0 { R::ONE } else { v[5] };
            let factor = theta_x[usize::from(ex) % 9][0] * a[usize::from(ea) % 9][0] * b;
            sum = A::mul_add(inner.u[l], factor, sum);
        }
        sum
    }

    /// The wrench h that holds the pose.
    #[inline(always)]
    pub(crate) fn wrench<A: Arithmetic<R>>(&self, pose: &Pose<R>) -> Wrench<R> {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let v = Symmetry::Revolution.variables(&q);
        let inner = black_box(self.inner::<A, false>(&v));
        let (first, _) = self.combined::<A, false>(&v, &inner);
        frame.wrench(&Symmetry::Revolution.gradient(&q, &first))
    }

    /// h, and the stiffness of one kind.
    #[inline(always)]
    pub(crate) fn wrench_and_stiffness<A: Arithmetic<R>>(
        &self,
        pose: &Pose<R>,
        kind: StiffnessKind,
    ) -> (Wrench<R>, Mat6<R>) {
        let frame = MidFrame::new(pose, self.length_m);
        let v = Symmetry::Revolution.variables(&frame.coordinates());
        // Forced into memory, so that the compiler keeps vectors: twice as fast as without.
        let inner = black_box(self.inner::<A, true>(&v));
        let (first, second) = self.combined::<A, true>(&v, &inner);
        let derivatives = (&first, &second);
        wrench_and_stiffness(&frame, Symmetry::Revolution, derivatives, pose, kind)
    }

    #[inline(always)]
    fn inner<A: Arithmetic<R>, const SECOND: bool>(&self, v: &Vec6<R>) -> Inner<R, B> {
        let [x, p, t, ..] = *v;
        let mut rest = self.coefficients;
        let mut sums = Inner::zero();
        // One power of |c⊥|²: for each power of |θ⊥|² so many coefficients of powers of c_x.
        // Unrolled, so that all sums stay in registers.
        macro_rules! powers {
            ($($count:literal)*) => {{
                let mut level = Inner::zero();
                $(rest = level.add_row::<A, SECOND, $count>(rest, x, t);)*
                sums.add_level::<A, SECOND>(&level, p);
            }};
        }
        match self.levels {
            Levels::Four => {
                powers!(1);
                powers!(1 3);
                powers!(1 3 5);
            }
            Levels::Five => {
                powers!(2);
                powers!(2 4);
                powers!(2 4 6);
            }
            Levels::Six => {
                powers!(1);
                powers!(1 3);
                powers!(1 3 5);
                powers!(1 3 5 7);
            }
            Levels::Seven => {
                powers!(2);
                powers!(2 4);
                powers!(2 4 6);
                powers!(2 4 6 8);
            }
            Levels::Eight => {
                powers!(1);
                powers!(1 3);
                powers!(1 3 5);
                powers!(1 3 5 7);
                powers!(1 3 5 7 9);
            }
        }
        sums
    }

    /// ∂U/∂v and, with `SECOND`, ∂²U/∂v², summed over the lanes.
    #[inline(always)]
    fn combined<A: Arithmetic<R>, const SECOND: bool>(
        &self,
        v: &Vec6<R>,
        g: &Inner<R, B>,
    ) -> (Vec6<R>, Mat6<R>) {
        let [_, _, _, theta_x, a, b] = *v;
        let (tx, ta) = (powers(theta_x), powers(a));
        let mut s = [R::ZERO; 6];
        let mut h = [[R::ZERO; 6]; 6];
        let add = |sum: &mut R, x: R, y: R| *sum = A::mul_add(x, y, *sum);
        for (l, &[ex, ea, eb]) in self.powers.iter().enumerate() {
            let (x, y) = (&tx[usize::from(ex) % 9], &ta[usize::from(ea) % 9]);
            // b enters with power 0 or 1.
            let (n, dn) = if eb == 0 {
                (R::ONE, R::ZERO)
            } else {
                (b, R::ONE)
            };
            let (xn, yn) = (x[1] * n, y[1] * n);
            let plain = x[0] * y[0] * n;
            let first = [xn * y[0], x[0] * yn, x[0] * y[0] * dn];
            add(&mut s[0], g.x[l], plain);
            add(&mut s[1], g.p[l], plain);
            add(&mut s[2], g.t[l], plain);
            for i in 0..3 {
                add(&mut s[3 + i], g.u[l], first[i]);
            }
            if SECOND {
                add(&mut h[0][0], g.xx[l], plain);
                add(&mut h[0][1], g.xp[l], plain);
                add(&mut h[0][2], g.xt[l], plain);
                add(&mut h[1][1], g.pp[l], plain);
                add(&mut h[1][2], g.pt[l], plain);
                add(&mut h[2][2], g.tt[l], plain);
                for i in 0..3 {
                    add(&mut h[0][3 + i], g.x[l], first[i]);
                    add(&mut h[1][3 + i], g.p[l], first[i]);
                    add(&mut h[2][3 + i], g.t[l], first[i]);
                }
                add(&mut h[3][3], g.u[l], x[2] * y[0] * n);
                add(&mut h[3][4], g.u[l], xn * y[1]);
                add(&mut h[3][5], g.u[l], x[1] * y[0] * dn);
                add(&mut h[4][4], g.u[l], x[0] * y[2] * n);
                add(&mut h[4][5], g.u[l], x[0] * y[1] * dn);
            }
        }
        for i in 0..3 {
            h[i][i] = R::TWO * h[i][i];
        }
        for i in 0..6 {
            for j in 0..i {
                h[i][j] = h[j][i];
            }
        }
        (s, h)
    }
}

/// zᵉ and its first two derivatives, e = 0 … 8.
#[inline(always)]
fn powers<R: Real>(z: R) -> [[R; 3]; MAX_POWER + 1] {
    let mut table = [[R::ZERO; 3]; MAX_POWER + 1];
    table[0][0] = R::ONE;
    for e in 1..=MAX_POWER {
        let [value, first, _] = table[e - 1];
        let factor = R::from_u16(e as u16);
        table[e] = [value * z, factor * value, factor * first];
    }
    table
}

/// sum z + c, lane by lane.
#[inline(always)]
fn horner<R: Real, A: Arithmetic<R>, const B: usize>(sum: &mut [R; B], z: R, c: &[R; B]) {
    for l in 0..B {
        sum[l] = A::mul_add(sum[l], z, c[l]);
    }
}
