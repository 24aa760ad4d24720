//! Poses, wrenches and mid-frame coordinates on SE(3), without std
