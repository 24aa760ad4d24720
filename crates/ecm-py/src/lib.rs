//! Python bindings of the ECM crates
