//! What a design is good for.

pub mod d;
pub mod linear;
pub mod maximin;
pub mod minimax;
pub(crate) mod model_based;
