//! Pictures and videos of a task. No networks.
//!
//! A [`Film`] keeps the states of episodes while they run, [`Playback`] chooses those that become
//! pictures, a [`Painter`] draws them, and an [`Encoder`] writes them to a file.

mod film;
mod output;
mod painter;
mod playback;

pub use film::{Film, Shot};
pub use mujoco_rs::render::{LARGEST_SIDE, Picture, RenderError, available};
pub use output::{Encoder, Format, OutputError, create};
pub use painter::{PaintError, Painter};
pub use playback::{Cut, Playback, Ticks};

/// What can go wrong between a state and a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FilmError {
    /// A picture cannot be drawn.
    #[error(transparent)]
    Paint(#[from] PaintError),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Draws the pictures that `playback` chooses of `film` and hands them to `encoder`. After each,
/// `go_on` is asked; tells whether it always agreed.
///
/// # Errors
/// If a picture cannot be drawn or written.
pub fn develop(
    film: &Film,
    playback: &mut Playback,
    painter: &mut Painter,
    encoder: &mut dyn Encoder,
    mut go_on: impl FnMut() -> bool,
) -> Result<bool, FilmError> {
    for cut in playback.cuts(film.shots().len()) {
        let picture = painter.paint(&film.shots()[cut.shot])?;
        encoder.push(&picture, cut.ticks)?;
        if !go_on() {
            return Ok(false);
        }
    }
    Ok(true)
}
