//! Many load cases, each from its nearest solved neighbour.
