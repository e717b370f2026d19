use std::ffi::CString;
use std::marker::PhantomData;
use std::mem::MaybeUninit;
use std::os::raw::{c_int, c_uint};
use std::sync::Arc;

use mujoco_sys as sys;

use super::RenderError;
use super::context::Context;
use super::platform::platform;
use crate::guard;
use crate::{Data, Error, Model};

/// Most pixels along a side of a picture.
pub const LARGEST_SIDE: usize = 4096;

/// Shapes of a scene besides those of the model: lights, tendons and the like.
const MORE_SHAPES: usize = 1000;
/// Bytes of a pixel: red, green, blue.
const CHANNELS: usize = 3;
/// Height of what is drawn, in pixels, from which captions have each size of letters, in per cent.
const LETTERS: [(usize, c_uint); 3] = [
    (1800, sys::mjFONTSCALE_300),
    (1050, sys::mjFONTSCALE_200),
    (700, sys::mjFONTSCALE_150),
];
/// The smallest letters that MuJoCo 2.2 has, which fit this height.
const SMALLEST_LETTERS: c_uint = sys::mjFONTSCALE_100;
const FITTING_HEIGHT: usize = 400;

const MOST_FINENESS: usize = 2;

/// From where a picture is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Camera {
    /// From a place that the whole model is seen from.
    #[default]
    Overview,
    /// By the model's camera with this id.
    Model(usize),
}

/// A corner of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Corner {
    /// Top left.
    TopLeft,
    /// Top right.
    TopRight,
    /// Bottom left.
    BottomLeft,
    /// Bottom right.
    BottomRight,
}

/// Two columns of text in a corner of a picture. Characters other than ASCII are replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caption {
    /// Where it is written.
    pub corner: Corner,
    /// Left column, a line a row.
    pub left: String,
    /// Right column.
    pub right: String,
}

/// A drawn picture.
#[derive(Clone, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Red, green and blue of each pixel, rows from the top.
    pub rgb: Vec<u8>,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Picture")
            .field("width", &self.width)
            .field("height", &self.height)
            .finish_non_exhaustive()
    }
}

/// Draws pictures of one size of one model.
///
/// It belongs to the thread that made it, as an OpenGL context does; any number may be in use, on the
/// same thread or on others.
pub struct Renderer {
    data: Data,
    camera: Camera,
    options: sys::mjvOption,
    scene: Box<sys::mjvScene>,
    drawing: Box<sys::mjrContext>,
    size: [usize; 2],
    /// Pixels that are drawn for one of the picture, along each side.
    fineness: usize,
    /// Dropped after what was made in it.
    context: Context,
    /// OpenGL contexts are bound to threads.
    _thread: PhantomData<*mut ()>,
}

impl Renderer {
    /// A renderer of pictures `[width, height]` in pixels.
    ///
    /// # Errors
    /// If there is no OpenGL library, or the size is not from 1 to [`LARGEST_SIDE`] or more than the
    /// library can do.
    pub fn new(model: &Model, size: [usize; 2]) -> Result<Self, RenderError> {
        let [width, height] = size;
        if size.iter().any(|side| !(1..=LARGEST_SIDE).contains(side)) {
            return Err(RenderError::Size(width, height));
        }
        let mut context = platform()?.context()?;
        if !context.make_current() {
            let reason = "the context cannot be made current".to_owned();
            return Err(RenderError::Context(reason));
        }
        let fineness = fineness(size);
        let drawn = size.map(|side| side * fineness);
        let model = Arc::new(model.for_pictures(drawn)?);
        let data = Data::new(Arc::clone(&model))?;

        let mut scene = Box::<sys::mjvScene>::new_uninit();
        let mut drawing = Box::<sys::mjrContext>::new_uninit();
        let mut options = MaybeUninit::<sys::mjvOption>::uninit();
        // SAFETY: each call initialises the whole structure and reads nothing of it.
        let (scene, drawing, options) = unsafe {
            sys::mjv_defaultScene(scene.as_mut_ptr());
            sys::mjr_defaultContext(drawing.as_mut_ptr());
            sys::mjv_defaultOption(options.as_mut_ptr());
            (
                scene.assume_init(),
                drawing.assume_init(),
                options.assume_init(),
            )
        };
        // From here on, `drop` frees whatever part of it was made.
        let mut renderer = Self {
            data,
            camera: Camera::default(),
            options,
            scene,
            drawing,
            size,
            fineness,
            context,
            _thread: PhantomData,
        };
        let most = c_int::try_from(model.ngeom() + model.nsite() + MORE_SHAPES);
        // SAFETY: the structures are initialised and owned, and the OpenGL context is current.
        unsafe {
            guard::check(sys::mjguard_makeScene(
                model.as_ptr(),
                &mut *renderer.scene,
                most.unwrap_or(c_int::MAX),
            ))?;
            guard::check(sys::mjguard_makeContext(
                model.as_ptr(),
                &mut *renderer.drawing,
                letters(drawn[1]) as c_int,
            ))?;
        }
        let made = [renderer.drawing.offWidth, renderer.drawing.offHeight];
        let smaller = |(made, asked): (c_int, usize)| (made as usize) < asked;
        if renderer.drawing.currentBuffer != sys::mjFB_OFFSCREEN as c_int
            || made.into_iter().zip(drawn).any(smaller)
        {
            return Err(RenderError::Buffer(width, height));
        }
        renderer.check_opengl()?;
        Ok(renderer)
    }

    /// Takes the following pictures from there. A camera that the model does not have takes the
    /// overview.
    pub fn set_camera(&mut self, camera: Camera) {
        self.camera = match camera {
            Camera::Model(id) if id >= self.data.model().ncam() => Camera::Overview,
            camera => camera,
        };
    }

    /// Shows or hides the geoms of a group (0 to 5); at first the first three are shown.
    pub fn show_group(&mut self, group: usize, shown: bool) {
        if let Some(flag) = self.options.geomgroup.get_mut(group) {
            *flag = u8::from(shown);
        }
    }

    /// A picture of the model at the positions `qpos` with these captions.
    ///
    /// # Errors
    /// If the model has another number of positions, or MuJoCo or OpenGL fail.
    pub fn picture(&mut self, qpos: &[f64], captions: &[Caption]) -> Result<Picture, RenderError> {
        let expected = self.data.qpos().len();
        if qpos.len() != expected {
            let found = qpos.len();
            return Err(RenderError::Positions { found, expected });
        }
        if !self.context.make_current() {
            let reason = "the context cannot be made current".to_owned();
            return Err(RenderError::Context(reason));
        }
        self.data.reset()?;
        self.data.qpos_mut().copy_from_slice(qpos);
        self.data.pose()?;

        let [width, height] = self.size.map(|side| side * self.fineness);
        let viewport = sys::mjrRect {
            left: 0,
            bottom: 0,
            width: width as c_int,
            height: height as c_int,
        };
        let mut camera = self.raw_camera();
        let model = self.data.model().as_ptr();
        // SAFETY: scene, context and data belong to this model, and the OpenGL context is current.
        unsafe {
            guard::check(sys::mjguard_updateScene(
                model,
                self.data.as_mut_ptr(),
                &self.options,
                &mut camera,
                &mut *self.scene,
            ))?;
            guard::check(sys::mjguard_render(
                viewport,
                &mut *self.scene,
                &*self.drawing,
            ))?;
        }
        for caption in captions {
            self.write(viewport, caption)?;
        }
        let mut pixels = vec![0; width * height * CHANNELS];
        // SAFETY: the buffer has room for the viewport; rows are read without padding.
        guard::check(unsafe {
            sys::mjguard_readPixels(pixels.as_mut_ptr(), viewport, &*self.drawing)
        })?;
        self.check_opengl()?;
        Ok(self.rows_from_top(&pixels))
    }

    /// The picture of what OpenGL drew, which begins at the bottom: each pixel is the mean of those that
    /// were drawn for it.
    fn rows_from_top(&self, drawn: &[u8]) -> Picture {
        let ([width, height], n) = (self.size, self.fineness);
        let row = width * n * CHANNELS;
        let mut rgb = Vec::with_capacity(width * height * CHANNELS);
        for y in (0..height).rev() {
            for x in 0..width {
                for channel in 0..CHANNELS {
                    let first = y * n * row + x * n * CHANNELS + channel;
                    let of_line = |j: usize| (0..n).map(move |i| first + j * row + i * CHANNELS);
                    let all = (0..n).flat_map(of_line).map(|at| usize::from(drawn[at]));
                    rgb.push((all.sum::<usize>() / (n * n)) as u8);
                }
            }
        }
        Picture { width, height, rgb }
    }

    fn raw_camera(&self) -> sys::mjvCamera {
        let mut camera = MaybeUninit::<sys::mjvCamera>::uninit();
        // SAFETY: initialises the whole structure and reads nothing of it; the model is valid.
        let mut camera = unsafe {
            sys::mjv_defaultFreeCamera(self.data.model().as_ptr(), camera.as_mut_ptr());
            camera.assume_init()
        };
        if let Camera::Model(id) = self.camera {
            camera.type_ = sys::mjCAMERA_FIXED as c_int;
            camera.fixedcamid = id as c_int;
        }
        camera
    }

    fn write(&mut self, viewport: sys::mjrRect, caption: &Caption) -> Result<(), RenderError> {
        let corner = match caption.corner {
            Corner::TopLeft => sys::mjGRID_TOPLEFT,
            Corner::TopRight => sys::mjGRID_TOPRIGHT,
            Corner::BottomLeft => sys::mjGRID_BOTTOMLEFT,
            Corner::BottomRight => sys::mjGRID_BOTTOMRIGHT,
        };
        let (left, right) = (printable(&caption.left), printable(&caption.right));
        // SAFETY: the texts are zero-terminated and shorter than MuJoCo's own limit, and the OpenGL
        // context is current.
        guard::check(unsafe {
            sys::mjguard_overlay(
                corner as c_int,
                viewport,
                left.as_ptr(),
                right.as_ptr(),
                &*self.drawing,
            )
        })?;
        Ok(())
    }

    fn check_opengl(&self) -> Result<(), RenderError> {
        // SAFETY: only reads OpenGL's error flag; the context is current.
        match unsafe { sys::mjr_getError() } {
            0 => Ok(()),
            code => Err(RenderError::OpenGl(code)),
        }
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        // What was made in a context can only be freed in it; without it, it goes with it.
        if self.context.make_current() {
            // SAFETY: owned, initialised, and made in the context that is now current.
            unsafe { sys::mjr_freeContext(&mut *self.drawing) };
        }
        // SAFETY: owned and initialised.
        unsafe { sys::mjv_freeScene(&mut *self.scene) };
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer")
            .field("size", &self.size)
            .field("camera", &self.camera)
            .finish_non_exhaustive()
    }
}

/// How many pixels are drawn for one of a picture, along each side: small pictures are drawn larger and
/// made smaller, letters and all.
fn fineness([width, height]: [usize; 2]) -> usize {
    let fitting = FITTING_HEIGHT.div_ceil(height).min(MOST_FINENESS);
    fitting.min(LARGEST_SIDE / width).max(1)
}

/// The size of letters for drawings of this height.
fn letters(height: usize) -> c_uint {
    let fitting = LETTERS.iter().find(|(from, _)| height >= *from);
    fitting.map_or(SMALLEST_LETTERS, |(_, scale)| *scale)
}

/// `text` as MuJoCo can write it: printable ASCII and ends of lines, not longer than its limit.
fn printable(text: &str) -> CString {
    const MOST: usize = sys::mjMAXOVERLAY as usize - 1;
    let known = |c: char| c == '\n' || c == ' ' || c.is_ascii_graphic();
    let text = text.chars().map(|c| if known(c) { c as u8 } else { b'?' });
    CString::new(text.take(MOST).collect::<Vec<_>>()).unwrap_or_default()
}

impl Model {
    /// A copy to draw pictures of this size with. Its planes are drawn up to the horizon, as far as they
    /// reach for whatever touches them.
    fn for_pictures(&self, [width, height]: [usize; 2]) -> Result<Model, Error> {
        self.changed(|raw| {
            raw.vis.global.offwidth = width as c_int;
            raw.vis.global.offheight = height as c_int;
            let planes = self.geom_type().iter().enumerate();
            for (plane, _) in planes.filter(|(_, kind)| **kind == sys::mjGEOM_PLANE as c_int) {
                // SAFETY: the copy has three sizes for each geom of the model.
                unsafe {
                    raw.geom_size
                        .add(3 * plane)
                        .cast::<[f64; 2]>()
                        .write([0.0; 2])
                };
            }
        })
    }
}
