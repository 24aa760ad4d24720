//! Prints how often a thousand evaluations of each model file ask the allocator for memory.
//!
//! A program beside the workspace, which forbids the unsafe code of an allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use ecm_poly::{Pose, PoseModel};

struct Counting;

static COUNT: AtomicUsize = AtomicUsize::new(0);

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::SeqCst);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() {
    for path in std::env::args().skip(1) {
        let text = std::fs::read_to_string(&path).expect("a file");
        let model = PoseModel::from_json(&text).expect("a model");
        let before = COUNT.load(Ordering::SeqCst);
        let mut sum = 0.0;
        for i in 0..1000 {
            let x = 1e-5 * f64::from(i);
            let pose = Pose::from_array(&[0.1034 + x, x, -x, 0.01 + x, 20.0 * x, -20.0 * x])
                .expect("a pose");
            let (h, k) = model.wrench_and_stiffness(&pose);
            sum += h.force[0] + k[5][5];
        }
        let after = COUNT.load(Ordering::SeqCst);
        println!("{} {sum}", after - before);
    }
}
