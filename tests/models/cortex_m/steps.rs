
#[unsafe(no_mangle)]
extern "C" fn neck_init(state: &mut neck::State<REAL>, p: &Pose) -> i32 {
    let found = neck::init(p);
    if let Some(start) = found {
        *state = start;
    }
    i32::from(found.is_some())
}

#[unsafe(no_mangle)]
extern "C" fn neck_step(
    state: &mut neck::State<REAL>,
    p: &Pose,
    dt: REAL,
    inputs: Option<&neck::Inputs<REAL>>,
    h: &mut [REAL; 6],
    k: &mut [[REAL; 6]; 6],
) -> i32 {
    let found = neck::step(state, p, dt, inputs.unwrap_or(&neck::DEFAULT_INPUTS));
    (*h, *k) = found.unwrap_or(([REAL::NAN; 6], [[REAL::NAN; 6]; 6]));
    i32::from(found.is_some())
}
