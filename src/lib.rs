//! Fills the gaps of motion-capture takes.
