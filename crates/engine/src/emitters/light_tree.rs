//! Importance sampling of many lights by a tree over them, descended by bounds on what either half
//! may shine on a point (Conty Estevez and Kulla 2018, "Importance sampling of many lights with
//! adaptive tree splitting"). A light that shines on the point never has the bound zero.

use glam::Vec3;

/// Bounds of a light, by which the tree picks it.
#[derive(Clone, Copy)]
pub struct LightBounds {
    /// Centre and radius of a ball around it.
    pub center: Vec3,
    /// See [`LightBounds::center`].
    pub radius: f32,
    /// Importance of the radiance times area: what one side emits, as one number.
    pub power: f32,
    /// Unit normal of the shining side.
    pub normal: Vec3,
    /// Whether both sides shine.
    pub two_sided: bool,
}

/// A group of lights: a node of the tree.
struct Node {
    center: Vec3,
    radius: f32,
    power: f32,
    /// Cone of the normals: its axis, and the cosine of the widest angle off that; −1 where a light
    /// shines to both sides.
    axis: Vec3,
    spread: f32,
    /// First of two children, which follow each other; the light of a leaf.
    first: u32,
    leaf: bool,
    parent: u32,
}

/// The tree over the lights, a light in each leaf.
pub struct LightTree {
    nodes: Vec<Node>,
    /// Leaf of each light.
    leaf: Vec<u32>,
}

impl LightTree {
    /// A tree of the lights; there must be at least one.
    pub fn new(lights: &[LightBounds]) -> Self {
        let mut tree = Self { nodes: Vec::new(), leaf: vec![0; lights.len()] };
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        tree.nodes.push(new_node(lights, &order, 0));
        let mut open = vec![(0, 0, order.len())];
        while let Some((at, begin, end)) = open.pop() {
            let group = &mut order[begin..end];
            if let [light] = group {
                tree.leaf[*light as usize] = at;
                (tree.nodes[at as usize].first, tree.nodes[at as usize].leaf) = (*light, true);
                continue;
            }
            let center = |light: &u32| lights[*light as usize].center;
            let low = group.iter().map(center).fold(Vec3::INFINITY, Vec3::min);
            let high = group.iter().map(center).fold(Vec3::NEG_INFINITY, Vec3::max);
            let axis = (high - low).max_position();
            let middle = group.len() / 2;
            group.select_nth_unstable_by(middle, |a, b| {
                center(a)[axis].total_cmp(&center(b)[axis]).then(a.cmp(b))
            });
            let first = tree.nodes.len() as u32;
            tree.nodes[at as usize].first = first;
            for (child, (begin, end)) in
                (first..).zip([(begin, begin + middle), (begin + middle, end)])
            {
                tree.nodes.push(new_node(lights, &order[begin..end], at));
                open.push((child, begin, end));
            }
        }
        tree
    }

    /// A light for a uniform number, and the probability that it is this one; `None` where no
    /// light can shine.
    pub fn pick(&self, point: Vec3, normal: Vec3, mut x: f32) -> Option<(usize, f32)> {
        let mut node = &self.nodes[0];
        let mut probability = 1.0;
        while !node.leaf {
            let first = self.share(node.first, point, normal)?;
            let child = if x < first {
                x /= first;
                probability *= first;
                node.first
            } else {
                x = (x - first) / (1.0 - first);
                probability *= 1.0 - first;
                node.first + 1
            };
            node = &self.nodes[child as usize];
        }
        Some((node.first as usize, probability))
    }

    /// The probability that [`LightTree::pick`] picks this light.
    pub fn probability(&self, light: usize, point: Vec3, normal: Vec3) -> f32 {
        let mut at = self.leaf[light];
        let mut probability = 1.0;
        while at != 0 {
            let parent = self.nodes[at as usize].parent;
            let first = self.nodes[parent as usize].first;
            let Some(share) = self.share(first, point, normal) else { return 0.0 };
            probability *= if at == first { share } else { 1.0 - share };
            at = parent;
        }
        probability
    }

    /// Probability of the first of two siblings; `None` where neither can shine.
    fn share(&self, first: u32, point: Vec3, normal: Vec3) -> Option<f32> {
        let [a, b] = [first, first + 1]
            .map(|node| self.nodes[node as usize].importance_bound(point, normal));
        (a + b > 0.0).then(|| a / (a + b))
    }
}

fn new_node(lights: &[LightBounds], group: &[u32], parent: u32) -> Node {
    let of = |light: &u32| lights[*light as usize];
    let low = group.iter().map(|l| of(l).center - of(l).radius).fold(Vec3::INFINITY, Vec3::min);
    let high =
        group.iter().map(|l| of(l).center + of(l).radius).fold(Vec3::NEG_INFINITY, Vec3::max);
    let center = 0.5 * (low + high);
    let reach = |l: &u32| of(l).center.distance(center) + of(l).radius;
    let axis = group.iter().map(|l| of(l).normal * of(l).power).sum::<Vec3>().normalize_or_zero();
    let off = |l: &u32| if of(l).two_sided { -1.0 } else { of(l).normal.dot(axis) };
    Node {
        center,
        radius: group.iter().map(reach).fold(0.0, f32::max),
        power: group.iter().map(|l| of(l).power).sum(),
        axis,
        spread: if axis == Vec3::ZERO { -1.0 } else { group.iter().map(off).fold(1.0, f32::min) },
        first: 0,
        leaf: false,
        parent,
    }
}

impl Node {
    /// Bound on the group's irradiance, as one number, on a surface at `point`, up to a constant
    /// factor.
    fn importance_bound(&self, point: Vec3, normal: Vec3) -> f32 {
        let between = self.center - point;
        let square = between.length_squared();
        let near = self.radius * self.radius;
        if square <= near {
            return self.power / near.max(f32::MIN_POSITIVE);
        }
        let direction = between / square.sqrt();
        // Half angle of the ball as seen from the point.
        let (sine, cosine) = ((near / square).sqrt(), (1.0 - near / square).sqrt());
        let ball = (cosine, sine);
        let received = cosine_of_difference(normal.dot(direction), ball);
        let spread = (self.spread, (1.0 - self.spread * self.spread).max(0.0).sqrt());
        let emitted = if self.spread <= -1.0 {
            1.0
        } else {
            // The angle is less by the cone's, then by the ball's.
            let inside = cosine_of_difference(-self.axis.dot(direction), spread);
            cosine_of_difference(inside, ball)
        };
        self.power * received.max(0.0) * emitted.max(0.0) / square
    }
}

/// cos(max(0, α − β)) of cos α and (cos β, sin β).
fn cosine_of_difference(cosine: f32, (other_cosine, other_sine): (f32, f32)) -> f32 {
    if cosine >= other_cosine {
        return 1.0;
    }
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    cosine * other_cosine + sine * other_sine
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lights() -> Vec<LightBounds> {
        (0..37)
            .map(|k| {
                let angle = k as f32;
                LightBounds {
                    center: Vec3::new((3.0 * angle).sin(), (1.7 * angle).cos(), angle / 20.0),
                    radius: 0.02 + 0.001 * angle,
                    power: 1.0 + angle,
                    normal: Vec3::new(angle.sin(), -1.0, angle.cos()).normalize(),
                    two_sided: k % 5 == 0,
                }
            })
            .collect()
    }

    #[test]
    fn probabilities_add_up_and_are_those_of_the_picks() {
        let tree = LightTree::new(&lights());
        let (point, normal) = (Vec3::new(0.2, -2.0, 0.4), Vec3::new(0.6, 0.8, 0.0));
        let all: f32 = (0..37).map(|light| tree.probability(light, point, normal)).sum();
        assert!((all - 1.0).abs() < 1e-4, "{all}");
        let mut counts = [0u32; 37];
        const COUNT: u32 = 40_000;
        for k in 0..COUNT {
            let x = (k as f32 + 0.5) / COUNT as f32;
            let (light, probability) = tree.pick(point, normal, x).unwrap();
            assert!((tree.probability(light, point, normal) / probability - 1.0).abs() < 1e-3);
            counts[light] += 1;
        }
        for (light, count) in counts.iter().enumerate() {
            let expected = tree.probability(light, point, normal);
            assert!((*count as f32 / COUNT as f32 - expected).abs() < 1e-3, "{light}");
        }
    }

    #[test]
    fn no_light_that_shines_is_left_out() {
        let lights = lights();
        let tree = LightTree::new(&lights);
        for k in 0..500 {
            let angle = k as f32 * 0.37;
            let point = Vec3::new(angle.sin(), (2.3 * angle).sin() * 1.5, (0.7 * angle).cos());
            let normal = Vec3::new((1.3 * angle).cos(), angle.sin(), (1.9 * angle).sin());
            let normal = normal.normalize();
            for (index, light) in lights.iter().enumerate() {
                let between = light.center - point;
                let facing = light.two_sided || light.normal.dot(-between) > 0.0;
                if facing && normal.dot(between) > 0.0 {
                    assert!(tree.probability(index, point, normal) > 0.0, "{k} {index}");
                }
            }
        }
    }
}
