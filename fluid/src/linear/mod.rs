//! Linear systems of node blocks.
