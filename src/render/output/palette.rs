//! Few colours for many: a palette by splitting the colours of a picture where they vary most.

use std::collections::BTreeMap;
use std::ops::Range;

/// Colours of a palette, one less than a GIF can have.
pub(super) const COLOURS: usize = 255;

/// Bits of a channel by which colours are told apart while the palette is made and looked up.
const BITS: u32 = 6;
/// Passes in which each colour of the palette moves to the middle of those it stands for.
const PASSES: usize = 3;
const UNKNOWN: u16 = u16::MAX;

type Colour = [f32; 3];

/// A palette, and which of its colours stands for which.
pub(super) struct Palette {
    bytes: Vec<u8>,
    colours: Vec<Colour>,
    /// For each colour of [`BITS`] bits a channel its index in the palette, once it was looked up.
    known: Vec<u16>,
}

/// A colour of a picture.
#[derive(Clone, Copy)]
struct Sample {
    colour: Colour,
    weight: f32,
}

impl Palette {
    /// A palette for the colours of a picture.
    pub(super) fn of(rgb: &[u8]) -> Palette {
        let samples = samples(rgb);
        let mut colours = split(samples.clone());
        for _ in 0..PASSES {
            colours = middles(&samples, &colours);
        }
        let byte = |x: f32| x.round().clamp(0.0, 255.0) as u8;
        let bytes: Vec<u8> = colours.iter().flatten().map(|x| byte(*x)).collect();
        let rounded = bytes.as_chunks::<3>().0.iter();
        Palette {
            colours: rounded.map(|colour| colour.map(f32::from)).collect(),
            bytes,
            known: vec![UNKNOWN; 1 << (3 * BITS)],
        }
    }

    /// Red, green and blue of each colour.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The index of each pixel of a picture, and the mean square error of a channel.
    pub(super) fn indices(&mut self, rgb: &[u8]) -> (Vec<u8>, f64) {
        let pixels = rgb.as_chunks::<3>().0;
        let mut error = 0.0;
        let index = |pixel: &[u8; 3]| {
            let known = &mut self.known[key(*pixel)];
            if *known == UNKNOWN {
                *known = nearest(&self.colours, pixel.map(f32::from)) as u16;
            }
            let colour = self.colours[usize::from(*known)];
            error += f64::from(distance(colour, pixel.map(f32::from)));
            *known as u8
        };
        let indices = pixels.iter().map(index).collect();
        (indices, error / (3 * pixels.len().max(1)) as f64)
    }
}

/// The colours of a picture. Rare ones weigh more than their share, so that a small thing keeps its
/// colour beside a large floor.
fn samples(rgb: &[u8]) -> Vec<Sample> {
    let mut sums: BTreeMap<usize, ([u64; 3], u64)> = BTreeMap::new();
    for pixel in rgb.as_chunks::<3>().0 {
        let (sum, count) = sums.entry(key(*pixel)).or_default();
        for (sum, x) in sum.iter_mut().zip(pixel) {
            *sum += u64::from(*x);
        }
        *count += 1;
    }
    let sample = |(sum, count): &([u64; 3], u64)| Sample {
        colour: sum.map(|x| x as f32 / *count as f32),
        weight: (*count as f32).sqrt(),
    };
    sums.values().map(sample).collect()
}

fn key(pixel: [u8; 3]) -> usize {
    let bits = |x: u8| usize::from(x >> (8 - BITS));
    let [r, g, b] = pixel.map(bits);
    (r << (2 * BITS)) | (g << BITS) | b
}

/// Splits the samples into as many groups as a palette has colours, each time the group with the
/// largest spread at its middle; the middle of each group.
fn split(mut samples: Vec<Sample>) -> Vec<Colour> {
    let mut groups: Vec<Range<usize>> = std::iter::once(0..samples.len()).collect();
    let mut spreads = vec![spread(&samples)];
    while groups.len() < COLOURS {
        let widest = (0..groups.len()).max_by(|a, b| {
            let of = |i: &usize| spreads[*i].iter().sum::<f32>();
            of(a).total_cmp(&of(b))
        });
        let Some(widest) = widest.filter(|i| spreads[*i].iter().sum::<f32>() > 0.0) else {
            break;
        };
        let range = groups[widest].clone();
        let group = &mut samples[range.clone()];
        let axis = (0..3).max_by(|a, b| spreads[widest][*a].total_cmp(&spreads[widest][*b]));
        let axis = axis.unwrap_or(0);
        let middle = mean(group)[axis];
        group.sort_by(|a, b| a.colour[axis].total_cmp(&b.colour[axis]));
        let low = group.partition_point(|sample| sample.colour[axis] < middle);
        let low = low.clamp(1, group.len() - 1);
        let (first, second) = (range.start..range.start + low, range.start + low..range.end);
        spreads[widest] = spread(&samples[first.clone()]);
        spreads.push(spread(&samples[second.clone()]));
        groups[widest] = first;
        groups.push(second);
    }
    groups
        .into_iter()
        .map(|group| mean(&samples[group]))
        .collect()
}

/// Weighted mean of the colours; black for none.
fn mean(samples: &[Sample]) -> Colour {
    let weight: f32 = samples.iter().map(|sample| sample.weight).sum();
    let sum = |i: usize| samples.iter().map(|s| s.weight * s.colour[i]).sum::<f32>();
    [0, 1, 2].map(|i| sum(i) / weight.max(f32::MIN_POSITIVE))
}

/// Weighted sum of the squared distances from the mean, a channel. One colour has none.
fn spread(samples: &[Sample]) -> [f32; 3] {
    if samples.len() < 2 {
        return [0.0; 3];
    }
    let mean = mean(samples);
    let square = |i: usize, s: &Sample| s.weight * (s.colour[i] - mean[i]).powi(2);
    [0, 1, 2].map(|i| samples.iter().map(|s| square(i, s)).sum())
}

/// Each colour moved to the mean of the samples that it is nearest to.
fn middles(samples: &[Sample], colours: &[Colour]) -> Vec<Colour> {
    let mut groups: Vec<Vec<Sample>> = vec![Vec::new(); colours.len()];
    for sample in samples {
        groups[nearest(colours, sample.colour)].push(*sample);
    }
    let moved = groups.iter().zip(colours).map(|(group, colour)| {
        if group.is_empty() {
            *colour
        } else {
            mean(group)
        }
    });
    moved.collect()
}

fn nearest(colours: &[Colour], colour: Colour) -> usize {
    let mut nearest = (0, f32::INFINITY);
    for (i, candidate) in colours.iter().enumerate() {
        let distance = distance(*candidate, colour);
        if distance < nearest.1 {
            nearest = (i, distance);
        }
    }
    nearest.0
}

/// Sum of the squared differences of the channels.
fn distance(a: Colour, b: Colour) -> f32 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_are_kept_as_they_are() {
        let rgb = [[0, 0, 0], [255, 0, 0], [3, 200, 77], [255, 0, 0]].concat();
        let mut palette = Palette::of(&rgb);
        let (indices, error) = palette.indices(&rgb);
        assert_eq!(error, 0.0);
        assert_eq!(indices[1], indices[3]);
        let at = 3 * usize::from(indices[2]);
        assert_eq!(palette.bytes()[at..at + 3], [3, 200, 77]);
        assert!(Palette::of(&[]).bytes().len() <= 3);
    }

    #[test]
    fn many_colours_become_few_and_a_rare_one_is_not_forgotten() {
        let mut rgb: Vec<u8> = (0..300 * 300)
            .flat_map(|i| [(i % 300 / 2) as u8, (i / 600) as u8, 40])
            .collect();
        rgb[..3].copy_from_slice(&[250, 250, 20]);
        let mut palette = Palette::of(&rgb);
        assert!(palette.bytes().len() <= 3 * COLOURS);
        let (indices, error) = palette.indices(&rgb);
        assert!(error < 30.0, "{error}");
        let at = 3 * usize::from(indices[0]);
        let rare = &palette.bytes()[at..at + 3];
        assert!(rare[0] > 240 && rare[1] > 240 && rare[2] < 30, "{rare:?}");
    }
}
