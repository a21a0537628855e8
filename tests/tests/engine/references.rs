//! References that several tests compare with, each made once.

use hemilux_engine::render::{Limits, RenderRequest};
use hemilux_engine::scene::made;
use hemilux_tests::halves::Halves;
use hemilux_tests::scenes::imported;
use std::sync::OnceLock;

/// Side of the picture of [`cornell_halves`].
pub const CORNELL_SIDE: u32 = 96;

/// The made Cornell box, path traced with 800 samples a pixel in each half.
pub fn cornell_halves() -> &'static Halves {
    static HALVES: OnceLock<Halves> = OnceLock::new();
    HALVES.get_or_init(|| {
        let request = RenderRequest {
            limits: Limits::iterations(800),
            ..RenderRequest::new(
                imported(&made::cornell()),
                "ray-traced",
                [CORNELL_SIDE, CORNELL_SIDE],
            )
        };
        Halves::traced(&request, 4.0)
    })
}
