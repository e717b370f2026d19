//! Between slices and tensors.

use burn::tensor::{Device, Tensor, TensorData};
use std::ops::Range;

/// A `[data.len() / width, width]` tensor over `data`, without copying it.
pub fn matrix(data: Vec<f32>, width: usize, device: &Device) -> Tensor<2> {
    let rows = data.len() / width;
    Tensor::from_data(TensorData::new(data, [rows, width]), device)
}

/// A `[data.len(), 1]` tensor over `data`.
pub fn column(data: Vec<f32>, device: &Device) -> Tensor<2> {
    matrix(data, 1, device)
}

/// The numbers of a tensor, row by row.
pub fn to_vec<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor
        .into_data()
        .try_into_vec::<f32>()
        .expect("every tensor here is single precision")
}

/// The rows `range` of a matrix of the given `width`.
pub fn rows_of<'a>(data: &'a [f32], width: usize, range: &Range<usize>) -> &'a [f32] {
    &data[range.start * width..range.end * width]
}

/// Matrices side by side, row by row; each part is its numbers and its width.
pub fn side_by_side(parts: &[(&[f32], usize)]) -> Vec<f32> {
    let rows = parts[0].0.len() / parts[0].1;
    let mut joined = Vec::with_capacity(parts.iter().map(|(data, _)| data.len()).sum());
    for row in 0..rows {
        for (data, width) in parts {
            joined.extend_from_slice(&data[row * width..(row + 1) * width]);
        }
    }
    joined
}
