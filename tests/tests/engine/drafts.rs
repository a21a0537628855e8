//! Jobs of little time begin with drafts: pictures of larger pixels, brought to the size that was asked
//! for where no whole one fits.

use hemilux_engine::checkpoint::Checkpoint;
use hemilux_engine::device::cpu::CpuDevice;
use hemilux_engine::render::{Begin, Limits, Observer, Progress, RenderRequest, Rendered};
use hemilux_engine::scene::made;
use hemilux_engine::transport::render;
use hemilux_tests::comparison::{away_from_light, relative_rmse};
use hemilux_tests::scenes::imported;
use std::sync::Arc;

/// Keeps what a job knows at its end.
#[derive(Default)]
struct Keeper(Option<Checkpoint>);

impl Observer for Keeper {
    fn wants_solution(&mut self, _: &Progress) -> bool {
        true
    }

    fn checkpoint(&mut self, checkpoint: Checkpoint) {
        self.0 = Some(checkpoint);
    }
}

fn request(glb: &[u8], size: [u32; 2], limits: Limits) -> RenderRequest {
    RenderRequest { limits, seed: 3, ..RenderRequest::new(imported(glb), "hemilux", size) }
}

fn done(request: &RenderRequest) -> (Rendered, Option<Checkpoint>) {
    let mut device = CpuDevice::new(None).expect("threads");
    let mut keeper = Keeper::default();
    let rendered = render(&mut device, request, &mut keeper).expect("the request is good");
    (rendered, keeper.0)
}

fn shrink(rendered: &Rendered) -> f64 {
    rendered.stats.diagnostics["draft"]
}

fn by_time(seconds: f64) -> Limits {
    Limits::seconds(seconds)
}

fn by_iterations(iterations: u64) -> Limits {
    Limits::iterations(iterations)
}

/// The picture has the size that was asked for, also where the draft's shape is another, and its
/// predicted error is the actual one within a factor of 1.6.
#[test]
fn a_draft_is_in_place_and_says_how_far_it_is_off() {
    let scenes = [("cornell", made::cornell()), ("phong", made::phong_cornell())];
    for (name, glb) in scenes {
        for size in [[160, 160], [213, 131]] {
            let (draft, _) = done(&request(&glb, size, by_time(0.001)));
            assert_eq!(shrink(&draft), 4.0, "{name}");
            let (reference, _) = done(&request(&glb, size, by_iterations(5)));
            assert_eq!(shrink(&reference), 1.0, "{name}");
            let counted = away_from_light(&reference.picture, 5.0);
            let actual = relative_rmse(&draft.picture, &reference.picture, counted);
            let predicted = draft.stats.figures.estimated_error.expect("it is not black");
            let ratio = predicted / actual;
            assert!((0.6..1.6).contains(&ratio), "{name} {size:?}: {predicted} beside {actual}");
            assert!(actual < 0.5, "{name} {size:?}: {actual}");
        }
    }
}

/// Whatever fits into the time, larger pixels, their light on the surfaces that the pixels asked for see, or
/// the picture itself, its predicted error is the actual one within a factor of 2.5.
#[test]
fn whatever_fits_says_how_far_it_is_off() {
    let glb = made::cornell();
    let size = [420, 420];
    let (reference, _) = done(&request(&glb, size, by_iterations(5)));
    let counted = away_from_light(&reference.picture, 5.0);
    for seconds in [0.1, 0.2, 0.4, 0.8] {
        let (rendered, _) = done(&request(&glb, size, by_time(seconds)));
        assert_eq!([rendered.picture.width, rendered.picture.height], size);
        let actual = relative_rmse(&rendered.picture, &reference.picture, &counted);
        let predicted = rendered.stats.figures.estimated_error.expect("it is not black");
        let (ratio, shrink) = (predicted / actual, shrink(&rendered));
        let what = format!("{seconds} s, pixels {shrink}: {predicted} beside {actual}");
        assert!((0.4..2.5).contains(&ratio) && actual < 0.3, "{what}");
    }
}

#[test]
fn a_draft_becomes_the_picture_where_there_is_time() {
    let (rendered, _) = done(&request(&made::cornell(), [720, 720], by_time(6.0)));
    assert_eq!(shrink(&rendered), 1.0);
    assert!(rendered.stats.figures.estimated_error.expect("it is lit") < 0.06);
    assert_eq!((rendered.picture.width, rendered.picture.height), (720, 720));
}

/// What a job's draft knows of the scene goes on, and its pixels do not: the picture is a whole one. Jobs
/// that may do but so many iterations have none.
#[test]
fn a_job_that_ended_with_a_draft_goes_on_with_whole_pictures() {
    let glb = made::cornell();
    let asked = request(&glb, [160, 160], by_time(0.001));
    let (draft, known) = done(&asked);
    assert_eq!(shrink(&draft), 4.0);
    let known = Arc::new(known.expect("a checkpoint was wanted"));
    let (reference, _) = done(&request(&glb, [160, 160], by_iterations(8)));
    let counted = away_from_light(&reference.picture, 5.0);
    for begin in [Begin::Continue(known.clone()), Begin::View(known)] {
        let goes_on = RenderRequest { limits: by_iterations(2), begin, ..asked.clone() };
        let (rendered, _) = done(&goes_on);
        assert_eq!(shrink(&rendered), 1.0);
        assert!(rendered.stats.diagnostics["records_reused"] > 0.0);
        let error = relative_rmse(&rendered.picture, &reference.picture, &counted);
        assert!(error < 0.06, "{error}");
    }
    let both = Limits { iterations: Some(1), ..by_time(0.001) };
    assert_eq!(shrink(&done(&RenderRequest { limits: both, ..asked }).0), 1.0);
}
