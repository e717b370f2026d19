//! Adam in one pass over the parameters.
//!
//! burn's own Adam makes a dozen passes and as many temporaries a parameter; this one keeps its
//! moments as plain slices, in the order in which the module visits its parameters. Group `adam` of
//! `benches/update.rs` times both.

use super::{LearningState, Mlp, TrainableMlp, WeightError};
use burn::module::{Module, ModuleMapper, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;
use multiversion::multiversion;

const BETA_1: f32 = 0.9;
const BETA_2: f32 = 0.999;
const EPSILON: f32 = 1e-8;

/// Adam (Kingma and Ba 2015, algorithm 1) with betas 0.9 and 0.999 and epsilon 1e-8.
#[derive(Debug, Clone)]
pub struct Adam {
    learning_rate: f32,
    steps: i32,
    /// First and second moments of each parameter.
    moments: Vec<Moments>,
    /// Whether all parameters and second moments were finite after every step.
    finite: bool,
}

/// Adam for a single number.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarAdam {
    learning_rate: f64,
    steps: i32,
    first: f64,
    second: f64,
}

impl ScalarAdam {
    /// Without a step so far.
    pub fn new(learning_rate: f64) -> ScalarAdam {
        ScalarAdam {
            learning_rate,
            steps: 0,
            first: 0.0,
            second: 0.0,
        }
    }

    /// Saves steps and moments as `<name>.steps` and so on.
    pub fn save(&self, name: &str, state: &mut LearningState) {
        state.set(&format!("{name}.steps"), self.steps.into());
        state.set(&format!("{name}.first"), self.first);
        state.set(&format!("{name}.second"), self.second);
    }

    /// Goes on from what was saved as `name`.
    ///
    /// # Errors
    /// When something of it is missing.
    pub fn restore(&mut self, name: &str, state: &LearningState) -> Result<(), WeightError> {
        self.steps = steps(name, state)?;
        self.first = state.number(&format!("{name}.first"))?;
        self.second = state.number(&format!("{name}.second"))?;
        Ok(())
    }

    /// What to subtract for this `gradient`.
    pub fn step(&mut self, gradient: f64) -> f64 {
        let [beta_1, beta_2, epsilon] = [BETA_1, BETA_2, EPSILON].map(f64::from);
        self.steps += 1;
        self.first = beta_1 * self.first + (1.0 - beta_1) * gradient;
        self.second = beta_2 * self.second + (1.0 - beta_2) * gradient * gradient;
        let first = self.first / (1.0 - beta_1.powi(self.steps));
        let second = self.second / (1.0 - beta_2.powi(self.steps));
        self.learning_rate * first / (second.sqrt() + epsilon)
    }
}

#[derive(Debug, Clone, Default)]
struct Moments {
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Adam {
    /// Without a step so far.
    pub fn new(learning_rate: f64) -> Adam {
        Adam {
            learning_rate: learning_rate as f32,
            steps: 0,
            moments: Vec::new(),
            finite: true,
        }
    }

    /// The same learning rate without a step so far.
    pub fn forgetful(&self) -> Adam {
        Adam {
            learning_rate: self.learning_rate,
            steps: 0,
            moments: Vec::new(),
            finite: true,
        }
    }

    /// Whether all parameters and second moments have been finite after every step. An infinite moment lets its
    /// parameter stand still, which no loss would tell.
    pub fn is_finite(&self) -> bool {
        self.finite
    }

    /// Saves the number of steps as `<name>.steps`, and the moments of each array of `mlp`, which is
    /// saved as `name`, as `<array>.first` and `<array>.second`.
    pub fn save(&self, name: &str, mlp: &Mlp, state: &mut LearningState) {
        state.set(&format!("{name}.steps"), self.steps.into());
        for ((array, shape), moments) in mlp.arrays(name).iter().zip(&self.moments) {
            state.set_array(&format!("{array}.first"), &moments.first, shape);
            state.set_array(&format!("{array}.second"), &moments.second, shape);
        }
    }

    /// Goes on from what was saved as `name`.
    ///
    /// # Errors
    /// When something of it is missing or has another shape than `mlp`.
    pub fn restore(
        &mut self,
        name: &str,
        mlp: &Mlp,
        state: &LearningState,
    ) -> Result<(), WeightError> {
        self.steps = steps(name, state)?;
        // Before the first step there are none.
        let arrays = if self.steps == 0 {
            Vec::new()
        } else {
            mlp.arrays(name)
        };
        let moments = arrays.iter().map(|(array, shape)| {
            Ok(Moments {
                first: state.arrays.get(&format!("{array}.first"), shape)?,
                second: state.arrays.get(&format!("{array}.second"), shape)?,
            })
        });
        self.moments = moments.collect::<Result<_, WeightError>>()?;
        Ok(())
    }

    /// `module` after one step down the sum of `gradients`, each of which has one for every
    /// parameter; `copy` is made equal to the result in the same pass.
    pub fn step(
        &mut self,
        module: TrainableMlp,
        gradients: Vec<GradientsParams>,
        copy: &mut Mlp,
    ) -> TrainableMlp {
        self.steps += 1;
        let correction = |beta: f32| 1.0 - f64::from(beta).powi(self.steps);
        self.moments
            .resize_with(copy.parameters().count(), Moments::default);
        let mut mapper = Mapper {
            step_size: (f64::from(self.learning_rate) / correction(BETA_1)) as f32,
            second_scale: (1.0 / correction(BETA_2).sqrt()) as f32,
            parameters: Box::new(self.moments.iter_mut().zip(copy.parameters_mut())),
            gradients,
            finite: true,
        };
        let module = module.map(&mut mapper);
        let finite = mapper.finite;
        self.finite &= finite;
        module
    }
}

/// The number of steps of the optimiser saved as `name`.
fn steps(name: &str, state: &LearningState) -> Result<i32, WeightError> {
    let name = format!("{name}.steps");
    let steps = state.count(&name)?;
    i32::try_from(steps).map_err(|_| WeightError::NotACount {
        name,
        number: steps as f64,
    })
}

struct Mapper<'a> {
    step_size: f32,
    second_scale: f32,
    /// Moments and copy of each parameter, in the order in which the module visits them.
    parameters: Box<dyn Iterator<Item = (&'a mut Moments, &'a mut Vec<f32>)> + 'a>,
    gradients: Vec<GradientsParams>,
    /// Whether all parameters and second moments are finite so far.
    finite: bool,
}

impl ModuleMapper for Mapper<'_> {
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let (moments, copy) = self.parameters.next().expect("one for each parameter");
        let id = param.id;
        let mut parts = self.gradients.iter_mut().filter_map(|g| g.remove::<D>(id));
        let Some(mut gradient) = parts.next().map(Tensor::into_data) else {
            return param;
        };
        let gradient = gradient.as_mut_slice::<f32>().expect("single precision");
        for more in parts {
            let more = more.into_data();
            let more = more.as_slice::<f32>().expect("single precision");
            gradient.iter_mut().zip(more).for_each(|(g, m)| *g += m);
        }

        moments.first.resize(gradient.len(), 0.0);
        moments.second.resize(gradient.len(), 0.0);
        let (step_size, second_scale) = (self.step_size, self.second_scale);
        let finite = &mut self.finite;
        param.map(|tensor| {
            let device = tensor.device();
            let mut data = tensor.without_autodiff().into_data();
            let parameter = data.as_mut_slice::<f32>().expect("single precision");
            *finite &= descend(
                parameter,
                gradient,
                &mut moments.first,
                &mut moments.second,
                step_size,
                second_scale,
            );
            copy.copy_from_slice(parameter);
            Tensor::from_data(data, &device).require_grad()
        })
    }
}

/// The step of one parameter, compiled for several instruction sets. None of them contracts
/// products and sums, so all give the same bits. Whether all parameters and second moments are finite.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn descend(
    parameter: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    step_size: f32,
    second_scale: f32,
) -> bool {
    // All bits of the exponent are set in infinities and NaNs. An "or" of integers, unlike a sum or a branch, is
    // taken of many numbers at once.
    const EXPONENT: u32 = 0x7f80_0000;
    let odd = |x: f32| u32::from(x.to_bits() & EXPONENT == EXPONENT);
    let mut any_odd = 0;
    let moments = first.iter_mut().zip(second);
    for ((p, g), (m, v)) in parameter.iter_mut().zip(gradient).zip(moments) {
        *m = BETA_1 * *m + (1.0 - BETA_1) * g;
        *v = BETA_2 * *v + (1.0 - BETA_2) * g * g;
        *p -= step_size * *m / (v.sqrt() * second_scale + EPSILON);
        any_odd |= odd(*v) | odd(*p);
    }
    any_odd == 0
}
