//! Static finite elements for soft mechanisms between a clamped base and a rigid platform
