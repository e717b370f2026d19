//! Few colours for many: the palette of a GIF, chosen by `color_quant`.

use color_quant::NeuQuant;
use std::collections::{BTreeMap, HashMap};

/// Colours of a palette, one less than a GIF can have.
pub(super) const COLOURS: usize = 255;

/// Every colour trains the quantiser, not one in so many: pictures are small.
const SAMPLING: i32 = 1;

/// A palette, and which of its colours stands for which.
pub(super) struct Palette {
    bytes: Vec<u8>,
    quantiser: Option<NeuQuant>,
    /// Indices of the colours that were looked up.
    known: HashMap<[u8; 3], u8>,
}

impl Palette {
    /// A palette for the colours of a picture, three bytes a pixel.
    ///
    /// The quantiser is shown a colour as often as the square root of the number of its pixels, so that a small thing
    /// keeps its colour beside a large floor.
    pub(super) fn of(rgb: &[u8]) -> Palette {
        let mut counts: BTreeMap<[u8; 3], u32> = BTreeMap::new();
        for colour in rgb.as_chunks::<3>().0 {
            *counts.entry(*colour).or_default() += 1;
        }
        if counts.len() <= COLOURS {
            let known = counts.keys().zip(0..).map(|(colour, i)| (*colour, i));
            return Palette {
                known: known.collect(),
                bytes: counts.keys().flatten().copied().collect(),
                quantiser: None,
            };
        }
        let mut shown = Vec::new();
        for ([r, g, b], count) in counts {
            let times = count.isqrt() as usize;
            shown.extend([r, g, b, 255].repeat(times));
        }
        let quantiser = NeuQuant::new(SAMPLING, COLOURS, &shown);
        Palette {
            bytes: quantiser.color_map_rgb(),
            quantiser: Some(quantiser),
            known: HashMap::new(),
        }
    }

    /// Red, green and blue of each colour.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The index of each pixel of a picture, and the mean square error of a channel.
    pub(super) fn indices(&mut self, rgb: &[u8]) -> (Vec<u8>, f64) {
        let (pixels, _) = rgb.as_chunks::<3>();
        let mut squares = 0;
        let mut indices = Vec::with_capacity(pixels.len());
        for pixel in pixels {
            let index = self.index(*pixel);
            let colour = &self.bytes[3 * usize::from(index)..][..3];
            let square = |(x, y): (&u8, &u8)| u64::from(x.abs_diff(*y)).pow(2);
            squares += pixel.iter().zip(colour).map(square).sum::<u64>();
            indices.push(index);
        }
        (indices, squares as f64 / (3 * pixels.len().max(1)) as f64)
    }

    fn index(&mut self, colour: [u8; 3]) -> u8 {
        let nearest = || match &self.quantiser {
            Some(quantiser) => {
                let [r, g, b] = colour;
                quantiser.index_of(&[r, g, b, 255]) as u8
            }
            // A later picture in the few colours of an earlier one.
            None => nearest(&self.bytes, colour),
        };
        *self.known.entry(colour).or_insert_with(nearest)
    }
}

fn nearest(palette: &[u8], colour: [u8; 3]) -> u8 {
    let distance = |candidate: &[u8; 3]| -> u32 {
        let channels = candidate.iter().zip(colour);
        channels.map(|(x, y)| u32::from(x.abs_diff(y)).pow(2)).sum()
    };
    let candidates = palette.as_chunks::<3>().0.iter().zip(0..);
    let nearest = candidates.min_by_key(|(candidate, _)| distance(candidate));
    nearest.map_or(0, |(_, index)| index)
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
        let (near, error) = palette.indices(&[250, 0, 6]);
        assert_eq!((near[0], error), (indices[1], (25.0 + 36.0) / 3.0));
        assert!(Palette::of(&[]).bytes().is_empty());
    }

    #[test]
    fn many_colours_become_few_and_a_small_thing_is_not_forgotten() {
        let mut rgb: Vec<[u8; 3]> = (0..300 * 300)
            .map(|i| [(i % 300 / 2) as u8, (i / 600) as u8, 40])
            .collect();
        // A ball of 12 x 12 pixels, shaded.
        for i in 0..144 {
            rgb[300 * (i / 12) + i % 12] = [200 + (i % 12) as u8, 190 + (i / 12) as u8, 20];
        }
        let rgb = rgb.concat();
        let mut palette = Palette::of(&rgb);
        assert!(palette.bytes().len() <= 3 * COLOURS);
        let (indices, error) = palette.indices(&rgb);
        assert!(error < 30.0, "{error}");
        let at = 3 * usize::from(indices[6 * 300 + 6]);
        let ball = &palette.bytes()[at..at + 3];
        let near = ball
            .iter()
            .zip([206, 196, 20])
            .all(|(x, y)| x.abs_diff(y) < 12);
        assert!(near, "{ball:?}");
    }
}
