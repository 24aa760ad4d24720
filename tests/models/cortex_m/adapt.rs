
use neck::adapt::{ADAPTER, Noise, Prior, Reading, State, reading};

const COUNT: usize = ADAPTER.priors.len();

/// The settings as the exported header has them.
#[repr(C)]
pub struct Settings {
    priors: [Prior<REAL>; COUNT],
    noise: Noise<REAL>,
    gravity: [REAL; 3],
    interval_s: REAL,
}

#[allow(non_upper_case_globals)]
#[unsafe(no_mangle)]
pub static neck_adapt_defaults: Settings = Settings {
    priors: ADAPTER.priors,
    noise: ADAPTER.noise,
    gravity: ADAPTER.gravity,
    interval_s: ADAPTER.interval_s,
};

#[unsafe(no_mangle)]
extern "C" fn neck_adapt_init(state: &mut State<REAL, COUNT>, _: Option<&Settings>) {
    *state = ADAPTER.init();
}

#[unsafe(no_mangle)]
extern "C" fn neck_adapt(
    state: &mut State<REAL, COUNT>,
    _: Option<&Settings>,
    p: &Pose,
    wrench: &[REAL; 6],
    dt: REAL,
    h: &[REAL; 6],
    k: &[[REAL; 6]; 6],
    branches: Option<&[[REAL; 6]; 2]>,
) -> i32 {
    let branches = branches.unwrap_or(&[[0.0; 6]; 2]);
    // 5: refused, as the exported C does where the pose is none.
    let one: Option<Reading<REAL>> = reading(p, wrench, (*h, *k), branches);
    one.map_or(5, |one| ADAPTER.step(state, &one, dt) as i32)
}
