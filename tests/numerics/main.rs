//! The numbers: updates against an independent implementation, tasks against the published ones.

mod hands;
mod physics;
mod physics_models;
mod update;
