//! The numbers: updates against an independent implementation, tasks against the published ones, policies
//! against doing nothing.

mod hands;
mod learning;
mod physics;
mod physics_models;
mod update;
