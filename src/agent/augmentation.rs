//! What is added to the critics' update: the one place that knows which augmentations there are. What each of them
//! does is its own file's.

use super::agent::Seen;
use super::critics::CriticRows;
use super::{Agent, Targets};
use crate::imagination::{Imagination, World};
use crate::nn::{Gradient, Memory, WeightError};
use crate::replay::Batch;

/// What is added to the critics' update.
pub enum Augmentation {
    /// Nothing: the base algorithm.
    None,
    /// Imaginary transitions by other actions (paper, section 4).
    Imagination(Imagination),
    /// Targets over imagined steps (Feinberg et al. 2018).
    Expansion {
        /// Where actions lead.
        world: World,
        /// Imagined steps after the real one, at least 1.
        horizon: usize,
    },
}

impl Augmentation {
    /// The world that is imagined, if any.
    pub fn world(&self) -> Option<&World> {
        match self {
            Augmentation::None => None,
            Augmentation::Imagination(imagination) => Some(&imagination.world),
            Augmentation::Expansion { world, .. } => Some(world),
        }
    }

    pub(super) fn world_mut(&mut self) -> Option<&mut World> {
        match self {
            Augmentation::None => None,
            Augmentation::Imagination(imagination) => Some(&mut imagination.world),
            Augmentation::Expansion { world, .. } => Some(world),
        }
    }

    pub(super) fn remember(&self, memory: &mut Memory) {
        if let Some(world) = self.world() {
            world.model.save_optimizer(memory);
        }
        if let Augmentation::Imagination(imagination) = self {
            imagination.remember(memory);
        }
    }

    pub(super) fn restore(&mut self, memory: &Memory) -> Result<(), WeightError> {
        if let Some(world) = self.world_mut() {
            world.model.restore_optimizer(memory)?;
        }
        match self {
            Augmentation::Imagination(imagination) => imagination.restore(memory),
            _ => Ok(()),
        }
    }

    /// Whether its targets take the place of those of equation 4.
    pub(super) fn replaces_targets(&self) -> bool {
        matches!(self, Augmentation::Expansion { .. })
    }

    /// The step of the model, and what is added to the targets.
    pub(super) fn augment(
        &mut self,
        agent: &Agent,
        gradient: Gradient,
        seen: &Seen<'_>,
        targets: &mut Targets,
    ) {
        match self {
            Augmentation::None => (),
            Augmentation::Imagination(imagination) => {
                let imaginary = agent.imaginary_targets(imagination, gradient, seen, targets);
                targets.imaginary = Some(imaginary);
            }
            Augmentation::Expansion { world, horizon } => {
                world.model.step(gradient);
                let expanded = agent.expanded_targets(world, *horizon, seen, &targets.observed);
                targets.y.clone_from(&expanded.positions[0].y);
                targets.expanded = Some(expanded);
            }
        }
    }
}

impl Targets {
    /// The rows that train the critics: the real ones first, then what augments them, in one batch.
    pub(super) fn rows(&self, batch: &Batch) -> CriticRows {
        if let Some(expanded) = &self.expanded {
            return expanded.rows();
        }
        let width = self.observed.len() / batch.rows;
        let mut rows = CriticRows::default();
        let weight = 1.0 / batch.rows as f32;
        rows.extend(&self.observed, width, &batch.action, &self.y, weight);
        if let Some(imaginary) = &self.imaginary {
            imaginary.extend(&mut rows, &self.observed, batch);
        }
        rows
    }
}
