//! Initial packings.
