//! The exported crate `neck` with the functions of the exported C, and the example of ecm-poly.
#![no_std]

#[path = "EXAMPLE"]
mod example;

use neck::{inside, value, value_and_stiffness};

type Pose = [REAL; 6];

#[unsafe(no_mangle)]
extern "C" fn neck_value(p: &Pose, h: &mut [REAL; 6]) {
    *h = value(p);
}

#[unsafe(no_mangle)]
extern "C" fn neck_value_and_stiffness(p: &Pose, h: &mut [REAL; 6], k: &mut [[REAL; 6]; 6]) {
    (*h, *k) = value_and_stiffness(p);
}

#[unsafe(no_mangle)]
extern "C" fn neck_inside(p: &Pose) -> i32 {
    i32::from(inside(p))
}

/// 0 where the example of ecm-poly gives what it promises.
#[unsafe(no_mangle)]
extern "C" fn example_of_ecm_poly() -> i32 {
    i32::from(!example::holds())
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {}
}
