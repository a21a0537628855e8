//! What pictures are judged by: files, or path tracing in two halves.

use super::bench::{Bench, Contender, View};
use crate::accuracy::Reference;
use crate::regions::without_emitters;
use crate::sheet::reduced;
use hemilux_engine::image::Picture;
use hemilux_engine::render::{
    CameraChoice, Limits, MAX_PICTURE_SIDE, RenderError, StopReason, choose_camera,
};
use hemilux_engine::scene::Scene;
use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

/// Seeds of a traced reference's halves; judged runs count from 1.
const SEEDS: [u64; 2] = [1_000_001, 1_000_002];
/// Sub-pixel samples that look for emitters.
const SAMPLES: u32 = 16;

/// A reference, and over which pixels it is used.
pub struct Truth {
    /// The reference.
    pub reference: Reference,
    /// Which pixels count: those that see no emitter.
    pub counted: Vec<bool>,
    /// Where it comes from and how good it is, in words.
    pub words: String,
}

/// Why there is no reference.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TruthError {
    /// The request cannot be met; whoever asked can mend it.
    Request(String),
    /// The work failed, or was ended early.
    Failed(String),
}

impl From<RenderError> for TruthError {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Parameter { .. } => Self::Request(error.to_string()),
            RenderError::Device(_) | RenderError::Checkpoint(_) => Self::Failed(error.to_string()),
        }
    }
}

impl Truth {
    fn new(
        reference: Reference,
        scene: &Scene,
        camera: &CameraChoice,
        origin: &str,
    ) -> Result<Self, TruthError> {
        let [half, _] = reference.halves();
        let size = (half.width, half.height);
        let (camera, _) = choose_camera(scene, camera, size.into())?;
        let counted = without_emitters(scene, &camera, size, SAMPLES);
        let refuse = |what: &str| Err(TruthError::Request(what.into()));
        if !counted.contains(&true) {
            return refuse("every pixel sees a light; there is nothing to compare");
        }
        // Not `<= 0`: it may be no number.
        let lit = reference.mean(&counted) > 0.0;
        if !lit {
            return refuse(
                "the reference is black where no light is seen; relative errors need light",
            );
        }
        let own = 100.0 * reference.own_error(&counted);
        let noise = match (reference.is_single(), own.is_nan()) {
            (true, _) => "what noise it has is in every figure".into(),
            (false, true) => "its own noise is too small to be told".into(),
            (false, false) => {
                format!("its own noise, rRMSE {own:.2} %, is subtracted from the figures")
            }
        };
        Ok(Self { reference, counted, words: format!("{origin}; {noise}") })
    }

    /// Pixels that count, of all.
    pub fn counted_pixels(&self) -> (usize, usize) {
        (self.counted.iter().filter(|counted| **counted).count(), self.counted.len())
    }
}

/// A reference from one EXR file, or from two that are independent halves of it; `size` is that
/// of the pictures to judge, by default the reference's own. A larger reference is reduced where
/// its sides are whole multiples.
///
/// # Errors
/// [`TruthError::Request`] where the files don't read or don't fit.
pub fn from_files(
    files: &[(String, Vec<u8>)],
    size: Option<(u32, u32)>,
    scene: &Scene,
    camera: &CameraChoice,
) -> Result<Truth, TruthError> {
    let mut pictures = files.iter().map(|(name, bytes)| read(name, bytes, size));
    let origin: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let origin = origin.join(" and ");
    let reference = match (pictures.next(), pictures.next(), pictures.next()) {
        (Some(only), None, None) => Reference::single(only?),
        (Some(first), Some(second), None) => {
            let (first, second) = (first?, second?);
            if (first.width, first.height) != (second.width, second.height) {
                return Err(TruthError::Request(
                    "the halves of the reference differ in size".into(),
                ));
            }
            if first == second {
                let what = "the halves of the reference are the same picture; give it once";
                return Err(TruthError::Request(what.into()));
            }
            Reference::new(first, second)
        }
        _ => {
            let what = "a reference is one picture, or two independent halves of one";
            return Err(TruthError::Request(what.into()));
        }
    };
    Truth::new(reference, scene, camera, &origin)
}

fn read(name: &str, bytes: &[u8], size: Option<(u32, u32)>) -> Result<Picture, TruthError> {
    let refuse = |what: String| TruthError::Request(format!("{name}: {what}"));
    let picture = Picture::from_exr(bytes).map_err(|error| refuse(error.to_string()))?;
    let own = (picture.width, picture.height);
    if own.0.max(own.1) > MAX_PICTURE_SIDE {
        return Err(refuse(format!("a side is longer than {MAX_PICTURE_SIDE} pixels")));
    }
    if !picture.pixels.iter().all(|pixel| pixel.is_finite()) {
        return Err(refuse("some pixels are not finite numbers".into()));
    }
    let wanted = size.unwrap_or(own);
    let factor = own.0 / wanted.0.max(1);
    if factor == 0 || (wanted.0 * factor, wanted.1 * factor) != own {
        let ((w, h), (a, b)) = (own, wanted);
        let what = format!("{w}×{h} pixels are no whole multiple of the asked {a}×{b}");
        return Err(refuse(what));
    }
    reduced(&picture, factor).map_err(refuse)
}

/// A reference by path tracing for `seconds`, in two halves.
///
/// # Errors
/// [`TruthError::Request`] where the view can't be rendered as asked, else
/// [`TruthError::Failed`].
pub fn trace(view: &View, seconds: f64, bench: &mut Bench<'_>) -> Result<Truth, TruthError> {
    let tracer = Contender { method: "ray-traced".into(), options: BTreeMap::new() };
    let limits = Limits::seconds(0.5 * seconds);
    let mut halves = Vec::new();
    for (at, seed) in SEEDS.into_iter().enumerate() {
        let what = format!("reference, half {} of 2, {} s", at + 1, 0.5 * seconds);
        (bench.say)(&what, 0.5 * at as f64);
        let rendered = bench.render(&view.request(&tracer, limits, seed));
        let rendered = rendered.map_err(|what| TruthError::Failed(format!("reference: {what}")))?;
        if bench.interrupted.load(Ordering::Relaxed) {
            return Err(TruthError::Failed("ended before there was a reference".into()));
        }
        if rendered.stats.stopped == StopReason::NoLight {
            return Err(TruthError::Request("nothing in the scene emits light".into()));
        }
        halves.push(rendered);
    }
    let passes: Vec<String> =
        halves.iter().map(|half| half.stats.figures.iterations.to_string()).collect();
    let took: f64 = halves.iter().map(|half| half.stats.seconds_solve).sum();
    let origin = format!(
        "path traced for {took:.1} s in two halves of {} paths a pixel",
        passes.join(" and ")
    );
    let mut pictures = halves.into_iter().map(|half| half.picture);
    match (pictures.next(), pictures.next()) {
        (Some(first), Some(second)) => {
            Truth::new(Reference::new(first, second), &view.scene, &view.camera, &origin)
        }
        _ => Err(TruthError::Failed("there is no reference".into())),
    }
}
