//! Named arrays, as saved in `safetensors` files.

use burn::tensor::TensorData;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::{BTreeMap, HashMap};

/// Named single-precision arrays.
#[derive(Debug, Default, Clone)]
pub struct Weights(BTreeMap<String, TensorData>);

/// Why arrays can't be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WeightError {
    /// An array is not there.
    #[error("array `{0}` is missing")]
    Missing(String),
    /// An array has another shape than the settings say.
    #[error("array `{name}` has shape {found:?}, expected {expected:?}")]
    Shape {
        /// Name of the array.
        name: String,
        /// Its shape in the file.
        found: Vec<usize>,
        /// The shape the settings ask for.
        expected: Vec<usize>,
    },
    /// An array holds a number that is not finite.
    #[error("array `{0}` holds a number that is not finite")]
    NotFinite(String),
    /// A bound or a deviation is not above 0.
    #[error("array `{0}` holds a number that is not above 0")]
    NotPositive(&'static str),
    /// What should be a count is none.
    #[error("`{name}` is {number}, not a count")]
    NotACount {
        /// Its name.
        name: String,
        /// What it is.
        number: f64,
    },
    /// Not a `safetensors` file of single-precision arrays, or cut short.
    #[error("not a whole safetensors file of 32-bit floats: {0}")]
    Format(String),
}

impl Weights {
    /// Adds an array of single-precision numbers.
    pub fn insert(&mut self, name: String, data: TensorData) {
        self.0.insert(name, data);
    }

    /// The names of the arrays, ascending.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// The first array that holds a number that is not finite.
    pub fn not_finite(&self) -> Option<&str> {
        let finite = |data: &TensorData| {
            data.as_slice::<f32>()
                .is_ok_and(|numbers| numbers.iter().all(|x| x.is_finite()))
        };
        self.0
            .iter()
            .find(|(_, data)| !finite(data))
            .map(|(name, _)| name.as_str())
    }

    /// The numbers of the array `name`, row by row.
    ///
    /// # Errors
    /// When it is missing or has another shape.
    pub fn get(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, WeightError> {
        let data = self
            .0
            .get(name)
            .ok_or_else(|| WeightError::Missing(name.to_owned()))?;
        let found: Vec<usize> = data.shape().to_vec();
        if found != shape {
            return Err(WeightError::Shape {
                name: name.to_owned(),
                found,
                expected: shape.to_vec(),
            });
        }
        let numbers = data.as_slice::<f32>();
        Ok(numbers
            .map_err(|e| WeightError::Format(format!("{e:?}")))?
            .to_vec())
    }

    /// As the bytes of a `safetensors` file with `metadata`.
    ///
    /// # Errors
    /// When an array is not of single precision.
    pub fn to_bytes(&self, metadata: HashMap<String, String>) -> Result<Vec<u8>, WeightError> {
        let format = |e: safetensors::SafeTensorError| WeightError::Format(e.to_string());
        let views: Vec<(&String, TensorView<'_>)> = self
            .0
            .iter()
            .map(|(name, data)| {
                let view = TensorView::new(Dtype::F32, data.shape().to_vec(), data.as_bytes());
                Ok((name, view.map_err(format)?))
            })
            .collect::<Result<_, WeightError>>()?;
        safetensors::serialize(views, Some(metadata)).map_err(format)
    }

    /// Arrays and metadata of the bytes of a `safetensors` file.
    ///
    /// # Errors
    /// When the bytes are cut short or damaged, an array is not of single precision or a number is
    /// not finite (`scaling.clip` may be infinite: no clipping).
    pub fn from_bytes(bytes: &[u8]) -> Result<(Weights, HashMap<String, String>), WeightError> {
        let format = |e: safetensors::SafeTensorError| WeightError::Format(e.to_string());
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(format)?;
        let metadata = header.metadata().clone().unwrap_or_default();
        let mut weights = Weights::default();
        for (name, view) in SafeTensors::deserialize(bytes).map_err(format)?.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(WeightError::Format(format!(
                    "array `{name}` is {:?}",
                    view.dtype()
                )));
            }
            let numbers: Vec<f32> = view
                .data()
                .chunks_exact(4)
                .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
                .collect();
            if name != "scaling.clip" && numbers.iter().any(|x| !x.is_finite()) {
                return Err(WeightError::NotFinite(name.to_owned()));
            }
            weights.insert(
                name.to_owned(),
                TensorData::new(numbers, view.shape().to_vec()),
            );
        }
        Ok((weights, metadata))
    }
}
