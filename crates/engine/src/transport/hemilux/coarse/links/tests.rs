use super::*;
use crate::transport::hemilux::coarse::direct::DirectLight;

fn direct(irradiance: f32) -> DirectLight {
    let irradiance = Rgb::splat(irradiance);
    DirectLight { irradiance, reflected_as: irradiance, share: 1.0, open: 1.0 }
}

/// Elements with that direct light that send nothing else.
fn sources(direct: &[DirectLight]) -> Sources<'_> {
    Sources { direct, far: None, glow: &[] }
}

/// Element 0 sees element 1 by half of its rays and nothing else, element 1 sees only element
/// 0: E_0 = ½ a_1 (D_1 + E_1), E_1 = a_0 (D_0 + E_0).
fn two_elements() -> Links {
    let round = Round {
        start: vec![0, 2, 3],
        links: vec![1, DARK, 0],
        spots: vec![CellSpot::MIDDLE; 3],
        bent: Vec::new(),
        tints: Vec::new(),
        bent_links: Vec::new(),
    };
    Links { rounds: vec![Arc::new(round)], bounced: Vec::new() }
}

fn only_round(links: &mut Links) -> &mut Round {
    Arc::get_mut(&mut links.rounds[0]).expect("nobody else has it")
}

#[test]
fn sweeps_solve_the_balance() {
    let (albedo, lit) = ([0.8, 0.5], [3.0, 1.0]);
    let mut links = two_elements();
    let direct = lit.map(direct);
    links.balance(&albedo.map(Rgb::splat), sources(&direct), &[]);
    // Both equations, solved by hand.
    let own = 0.5 * albedo[1] * (lit[1] + albedo[0] * lit[0]);
    let first = own / (1.0 - 0.5 * albedo[0] * albedo[1]);
    let second = albedo[0] * (lit[0] + first);
    for (bounced, exact) in links.bounced.iter().zip([first, second]) {
        assert!((bounced.x / exact - 1.0).abs() < 1e-3, "{bounced} {exact}");
    }
}

/// Through red glass element 0 sees only the red of element 1: E_0 = ½ a_1 D_1 there, as if it
/// were black otherwise.
#[test]
fn coloured_links_bring_coloured_light() {
    let mut links = two_elements();
    let lack = Rgb::new(0.0, 1.0, 0.25);
    only_round(&mut links).tints.push(Tint { from: 0, to: 1, lack });
    links.balance(&[Rgb::ZERO, Rgb::ONE], sources(&[1.0, 1.0].map(direct)), &[]);
    let expected = 0.5 * (Rgb::ONE - lack);
    assert!(links.bounced[0].abs_diff_eq(expected, 1e-5), "{}", links.bounced[0]);
    assert_eq!(links.bounced[1], Rgb::ZERO);
}

#[test]
fn links_bring_no_more_than_is_sent() {
    for left in [Rgb::new(0.0, 0.0, 14.0), Rgb::new(0.3, 0.6, 0.1), Rgb::ZERO, Rgb::ONE] {
        for has_tint in [false, true] {
            let (share, lack) = tint(left, has_tint);
            assert!((0.0..=1.0).contains(&share), "{share}");
            assert!(lack.min_element() >= 0.0 && lack.max_element() <= 1.0, "{lack}");
        }
    }
    let left = Rgb::new(0.3, 0.6, 0.1);
    let (share, lack) = tint(left, true);
    assert!(((Rgb::ONE - lack) * share).abs_diff_eq(left, 1e-6), "nothing is lost on average");
}

#[test]
fn rays_from_inside_a_body_do_not_count() {
    let mut links = two_elements();
    only_round(&mut links).links[1] = COVERED;
    links.balance(&[Rgb::ZERO, Rgb::ONE], sources(&[1.0, 1.0].map(direct)), &[]);
    // Half of the rays of element 0 start inside: the other half is all that it sees.
    assert!((links.bounced[0].x - 1.0).abs() < 1e-3, "{}", links.bounced[0]);
}

#[test]
fn links_come_back_and_damage_is_found() {
    for elements in [3, 70_000] {
        let start: Vec<u32> = (0..=elements as u32).collect();
        let links = (0..elements as u32).map(|e| [e, DARK, COVERED][e as usize % 3]);
        let bent = vec![Rgb::Y; elements];
        let tints = [0, 2].map(|from| Tint { from, to: 1, lack: Rgb::X }).to_vec();
        let spots = vec![CellSpot::MIDDLE; elements];
        let bent_links = vec![BentLink { from: 0, by: 2, to: DARK, light: 0.5 }];
        let round = Round { start, links: links.collect(), spots, bent, tints, bent_links };
        let bounced = vec![Rgb::splat(2.0); elements];
        let links = Links { rounds: vec![Arc::new(round)], bounced };
        let mut to = Writer::new(u64::MAX);
        links.save(elements, &mut to);
        let bytes = to.finish().expect("there is room");
        let again = Links::restore(elements, &mut Reader::new(&bytes)).expect("sound");
        assert_eq!(again.rounds[0].links, links.rounds[0].links);
        assert_eq!(again.rounds[0].bent, links.rounds[0].bent);
        assert_eq!(again.rounds[0].tints, links.rounds[0].tints);
        assert_eq!(again.rounds[0].bent_links, links.rounds[0].bent_links);
        assert_eq!(again.bounced, links.bounced);
        // Of fewer elements than the links lead to.
        assert!(Links::restore(elements - 1, &mut Reader::new(&bytes)).is_err());
    }
}

/// Where one element in a hundred, of most of the light, has not settled, the sweep is the last; where many
/// change it is not, nor where all light does.
#[test]
fn sweeps_end_when_most_elements_have_settled() {
    let before: Vec<Rgb> = (0..100).map(|_| Rgb::ONE).collect();
    let mut after = before.clone();
    assert!(is_settled(&before, &after));
    after[7] = Rgb::splat(1.01);
    let bright = |of: &[Rgb]| -> Vec<Rgb> {
        of.iter().enumerate().map(|(n, own)| if n == 7 { *own * 1e4 } else { *own }).collect()
    };
    assert!(is_settled(&bright(&before), &bright(&after)));
    after[8..40].fill(Rgb::splat(1.01));
    assert!(!is_settled(&before, &after));
}
