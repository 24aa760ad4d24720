
#[allow(non_upper_case_globals)]
#[unsafe(no_mangle)]
pub static neck_default_conditions: neck::Inputs<REAL> = neck::DEFAULT_INPUTS;
#[allow(non_upper_case_globals)]
#[unsafe(no_mangle)]
pub static neck_least_conditions: neck::Inputs<REAL> = neck::MEASURED_INPUTS[0];
#[allow(non_upper_case_globals)]
#[unsafe(no_mangle)]
pub static neck_largest_conditions: neck::Inputs<REAL> = neck::MEASURED_INPUTS[1];

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
    k: Option<&mut [[REAL; 6]; 6]>,
) -> i32 {
    written(neck::step(state, p, dt, inputs.unwrap_or(&neck::DEFAULT_INPUTS)), h, k)
}

#[unsafe(no_mangle)]
extern "C" fn neck_settled(
    p: &Pose,
    inputs: Option<&neck::Inputs<REAL>>,
    h: &mut [REAL; 6],
    k: Option<&mut [[REAL; 6]; 6]>,
) -> i32 {
    written(neck::settled(p, inputs.unwrap_or(&neck::DEFAULT_INPUTS)), h, k)
}

fn written(
    found: Option<([REAL; 6], [[REAL; 6]; 6])>,
    h: &mut [REAL; 6],
    k: Option<&mut [[REAL; 6]; 6]>,
) -> i32 {
    let (wrench, tangent) = found.unwrap_or(([REAL::NAN; 6], [[REAL::NAN; 6]; 6]));
    *h = wrench;
    if let Some(k) = k {
        *k = tangent;
    }
    i32::from(found.is_some())
}

#[unsafe(no_mangle)]
extern "C" fn neck_predict_ahead(
    state: &neck::State<REAL>,
    p: &Pose,
    count: i32,
    dt: REAL,
    inputs: Option<&neck::Inputs<REAL>>,
    h: *mut [REAL; 6],
    k: *mut [[REAL; 6]; 6],
) -> i32 {
    let inputs = inputs.unwrap_or(&neck::DEFAULT_INPUTS);
    // SAFETY: as the exported header says, `count` poses, and as many places in h, and in k or none.
    let path = unsafe { core::slice::from_raw_parts(p, count as usize) };
    let mut taken = 0;
    for (i, (wrench, tangent)) in neck::predict_ahead(state, path, dt, inputs).enumerate() {
        // SAFETY: i is less than count.
        unsafe {
            *h.add(i) = wrench;
            if !k.is_null() {
                *k.add(i) = tangent;
            }
        }
        taken += 1;
    }
    if taken < count {
        // SAFETY: taken is less than count.
        unsafe { *h.add(taken as usize) = [REAL::NAN; 6] };
    }
    taken
}

#[unsafe(no_mangle)]
extern "C" fn neck_inputs_inside(inputs: &neck::Inputs<REAL>) -> i32 {
    i32::from(neck::inputs_inside(inputs))
}
