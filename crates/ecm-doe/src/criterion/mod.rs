//! What a design is good for.

pub mod d;
pub mod maximin;
