//! Source of the part of this crate that needs no std, for exported models.

/// File name and content, below `src`.
pub const FILES: &[(&str, &str)] = &[
    ("lib.rs", include_str!("lib.rs")),
    ("error.rs", include_str!("error.rs")),
    ("jacobian.rs", include_str!("jacobian.rs")),
    ("linear.rs", include_str!("linear.rs")),
    ("mid_frame.rs", include_str!("mid_frame.rs")),
    ("pose.rs", include_str!("pose.rs")),
    ("real.rs", include_str!("real.rs")),
    ("rotation.rs", include_str!("rotation.rs")),
    ("stiffness.rs", include_str!("stiffness.rs")),
    ("stumpff.rs", include_str!("stumpff.rs")),
];
