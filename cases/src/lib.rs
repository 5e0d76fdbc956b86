//! The program `voidage` as a library: its commands, the small systems of exact behaviour ([`models`]) and the
//! verification suite made of them ([`verify`]).

pub mod check;
pub mod compare;
pub mod doctor;
pub mod models;
pub mod placing;
pub mod plot;
pub mod progress;
pub mod report;
pub mod run;
pub mod stability;
pub mod study;
pub mod suite;
pub mod verify;
