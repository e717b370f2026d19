//! The bound of the imaginary actions' noise.

/// `eta` of equation 7 and its decay `rho` (Algorithm 1, line 20). The bound shrinks, the
/// deviation of the noise stays 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseBound {
    bound: f64,
    rate: f64,
}

impl NoiseBound {
    /// Starts at `bound` (the action limit) and is multiplied by `rate` each update; 1 for none.
    pub fn new(bound: f64, rate: f64) -> NoiseBound {
        NoiseBound { bound, rate }
    }

    /// The same with `bound` as the bound now.
    pub fn at(self, bound: f64) -> NoiseBound {
        NoiseBound { bound, ..self }
    }

    /// The bound now.
    pub fn bound(&self) -> f64 {
        self.bound
    }

    /// Passes to the next update.
    pub fn decay(&mut self) {
        self.bound *= self.rate;
    }
}
