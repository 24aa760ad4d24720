//! Space filling: subsets whose closest pair is as far apart as possible.

pub(crate) mod cover;
pub(crate) mod neighbours;
pub(crate) mod simple;
pub(crate) mod threshold;
