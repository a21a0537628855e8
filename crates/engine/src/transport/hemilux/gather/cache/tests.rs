use super::*;
use crate::random::{Numbers, Stream};
use crate::transport::hemilux::specimen::{SEED, Specimen};
use std::f32::consts::PI;

/// Irradiance that all records have, before what is wrong with the coarse solution.
const EXACT: f32 = 10.0;
const RAYS: u32 = 64;

/// Records at every third fragment of a box. The coarse solution is off by `off` of their number and place, and
/// what is found afresh has noise of that standard deviation.
fn cache(
    visible: &VisibleSurfaces,
    deviation: f32,
    off: impl Fn(usize, &Record) -> f32,
) -> IrradianceCache {
    let mut numbers = Numbers::new(3, Stream::Gather, 0);
    let mut noise = || Rgb::splat((numbers.uniform() - 0.5) * 12f32.sqrt() * deviation);
    let per_ray = RAYS as f32 / PI;
    let mut cache = IrradianceCache::default();
    for (index, fragment) in visible.fragments.iter().enumerate().step_by(3) {
        let footprint = visible.frame.footprint(fragment.point, visible.height);
        let mut record = Record::new(fragment.point, fragment.normal, footprint, index as u32);
        (record.rays, record.radius) = (RAYS, 2.5 * footprint);
        record.sum = (Rgb::splat(EXACT) + noise()) * per_ray;
        record.split = noise() * per_ray;
        record.by_mesh = Rgb::splat(EXACT + off(index, &record)) * per_ray;
        cache.records.push(record);
    }
    cache
}

/// Root mean square, and mean, of by how much the records' values are off.
fn off(cache: &IrradianceCache) -> [f32; 2] {
    let off = |record: &Record| record.value.x - EXACT;
    let count = cache.records.len() as f32;
    let mean = cache.records.iter().map(off).sum::<f32>() / count;
    let square = cache.records.iter().map(|record| off(record).powi(2)).sum::<f32>() / count;
    [square.sqrt(), mean]
}

/// Noise of light found afresh is shared widely where the coarse solution says the rest, and what that is off
/// by all over is taken off.
#[test]
fn corrections_are_shared_widely() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    let mut cache = cache(&visible, 2.0, |_, _| -1.0);
    assert!(is_corrected_noisily(&cache.records));
    cache.smooth(&visible, true);
    let [widely, mean] = off(&cache);
    cache.asks_mesh = false;
    cache.smooth(&visible, true);
    let [as_before, _] = off(&cache);
    assert!(widely < 0.6 * as_before, "{widely} of {as_before}");
    assert!(mean.abs() < 0.2, "{mean}");
}

/// A coarse solution that is wrong here and there is put right, where rays know better.
#[test]
fn corrections_without_noise_are_taken_as_they_are() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    let mut cache =
        cache(
            &visible,
            0.0,
            |index, record| {
                if record.point.x > 0.5 { 3.0 } else { (index % 5) as f32 }
            },
        );
    assert!(!is_corrected_noisily(&cache.records), "nothing is noisy");
    cache.smooth(&visible, true);
    let [off, _] = off(&cache);
    assert!(off < 0.02 * EXACT, "{off}");
}

/// Itself and every n-th of its neighbours, however many there are.
#[test]
fn some_of_many_neighbours_are_asked() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    let cache = cache(&visible, 0.0, |_, _| 0.0);
    let tiles = RecordTiles::new(&visible, &cache.records);
    let index = cache.records.len() / 2;
    let heard = |most: usize| {
        let mut heard = Vec::new();
        tiles.each_near((index, &cache.records[index]), (8.0, most), |other| heard.push(other));
        heard
    };
    let (all, some) = (heard(usize::MAX), heard(20));
    assert!(all.len() > 60 && (10..=21).contains(&some.len()), "{} {}", all.len(), some.len());
    assert!(all.contains(&index) && some.contains(&index));
    assert!(some.iter().all(|other| all.contains(other)));
}

/// Where the time is up there are few records, and the next ones make up for it.
#[test]
fn records_that_had_no_time_are_made_later() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    let fill = |cache: &mut IrradianceCache, until: Option<Instant>| {
        let spacing = Spacing { scale: 1.0, least: 0.1, even: false };
        let gathering =
            Gathering { seed: SEED, rays: 32, new_rays: 32, afresh: true, spacing, until };
        cache.fill(&specimen.coarse, &visible, gathering, None);
        cache.len()
    };
    let mut whole = IrradianceCache::default();
    let all = fill(&mut whole, None);
    assert!(!whole.is_unfinished);
    let mut cut_short = IrradianceCache::default();
    let few = fill(&mut cut_short, Some(Instant::now()));
    assert!(cut_short.is_unfinished && few < all / 2, "{few} of {all}");
    let later = fill(&mut cut_short, None);
    assert!(!cut_short.is_unfinished && 10 * later > 9 * all, "{later} of {all}");
}

/// Shelves, seen along their undersides, and gaps between books: whatever a record was made for hears it, and
/// gets no other one instead.
#[test]
fn whatever_a_record_was_made_for_hears_it() {
    let specimen = Specimen::new(&crate::scene::made::office(), 10_000);
    let visible = specimen.visible();
    let filled = |at_home: bool| {
        let mut cache = IrradianceCache::default();
        let count = [1.0, 0.5, 0.5, 0.5].map(|scale| {
            let spacing = Spacing { scale, least: 0.1, even: false };
            let until = None;
            let gathering =
                Gathering { seed: SEED, rays: 16, new_rays: 16, afresh: false, spacing, until };
            cache.fill(&specimen.coarse, &visible, gathering, None);
            if !at_home {
                cache.records.iter_mut().for_each(|record| record.fragment = NO_FRAGMENT);
            }
            cache.smooth(&visible, true);
            cache.len()
        });
        let lit = cache.irradiance(&visible);
        let unheard = cache.records.iter().filter(|record| {
            let home =
                visible.fragments.iter().position(|one| visible.middle_point(one) == record.point);
            home.is_some_and(|home| lit[home].is_none())
        });
        (unheard.count(), count[3] - count[2])
    };
    let (unheard, again) = filled(true);
    assert_eq!(unheard, 0, "without light");
    let (unheard, in_vain) = filled(false);
    assert!(unheard > 0 && in_vain > again, "{unheard} without light, {in_vain} more and {again}");
}

/// Nothing tells how bent light is around a record that is alone: more are made there, and not elsewhere.
#[test]
fn a_record_that_is_alone_gets_company() {
    let specimen = Specimen::furnace();
    let visible = specimen.visible();
    let mut cache = IrradianceCache::default();
    let fill = |cache: &mut IrradianceCache| {
        let spacing = Spacing { scale: 2.0, least: 0.1, even: false };
        let gathering =
            Gathering { seed: SEED, rays: 16, new_rays: 16, afresh: false, spacing, until: None };
        cache.fill(&specimen.coarse, &visible, gathering, None);
    };
    (0..3).for_each(|_| fill(&mut cache));
    let before = cache.len();
    let middle = cache.records.iter().map(|record| record.point.x).sum::<f32>() / before as f32;
    cache.records.iter_mut().for_each(|record| record.is_alone = record.point.x < middle);
    fill(&mut cache);
    let added = &cache.records[before..];
    let company = added.iter().filter(|record| record.point.x < middle).count();
    assert!(company > 20, "{company} of {before}");
    assert!(added.len() - company < company / 5, "{} of {}", added.len() - company, added.len());
}
