//! A tree over triangles with their packets, and how a ray meets them.

use super::boxes::{Boxes, Slabs};
use super::hierarchy::{Boxed, Hierarchy};
use super::hit::Eye;
use super::triangle::{Crossing, Packet, Sheared, WIDTH};
use super::units::{BACK_RECEDES, CHUNK};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Triangles that are found by rays.
#[derive(Default)]
pub struct Tree {
    hierarchy: Hierarchy,
    /// The triangles, by leaf of the hierarchy.
    packets: Vec<Packet>,
}

/// A ray that looks for triangles.
pub struct Look {
    /// Where it begins.
    pub origin: Vec3,
    /// Where it goes; a unit vector in the world.
    pub direction: Vec3,
    /// The same as triangles need it.
    pub sheared: Sheared,
    /// How far behind the ray's true origin it begins, in lengths of the direction.
    pub offset: f32,
    /// Who looks.
    pub eye: Eye,
}

impl Look {
    /// The ray from `origin` along `direction`.
    #[inline(always)]
    pub fn new(origin: Vec3, direction: Vec3, offset: f32, eye: Eye) -> Self {
        Self { origin, direction, sheared: Sheared::new(origin, direction), offset, eye }
    }
}

/// What was found.
pub struct Found {
    /// Which leaf has it.
    pub leaf: u32,
    /// Where in the leaf.
    pub lane: u32,
    /// The crossing, whose distance is from where the ray begins.
    pub crossing: Crossing,
    /// Distance from the true origin at which it counts as seen: black backs are a little farther.
    pub seen_at: f32,
}

impl Tree {
    /// Bytes that it takes.
    pub fn held_bytes(&self) -> u64 {
        self.hierarchy.held_bytes() + size_of_val(&*self.packets) as u64
    }

    /// The tree over boxes of triangles, which `corners` and `two_sided` say more about.
    pub fn new(
        mut boxes: Vec<Boxed>,
        corners: impl Fn(u32) -> [Vec3; 3] + Sync,
        two_sided: impl Fn(u32) -> bool + Sync,
    ) -> Self {
        let hierarchy = Hierarchy::new(&mut boxes, WIDTH);
        let packet = |run: &Range<u32>| {
            let mut packet = Packet::EMPTY;
            for item in &boxes[run.start as usize..run.end as usize] {
                packet.push(item.index, corners(item.index), two_sided(item.index));
            }
            packet
        };
        let packets = hierarchy.leaves().par_iter().with_min_len(CHUNK).map(packet).collect();
        Self { hierarchy, packets }
    }

    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.packets.is_empty()
    }

    /// Number of leaves.
    #[cfg(test)]
    pub fn leaves(&self) -> usize {
        self.packets.len()
    }

    /// The triangles of a leaf.
    #[inline(always)]
    pub fn packet(&self, leaf: u32) -> &Packet {
        &self.packets[leaf as usize]
    }

    /// What a ray meets first before `end`, a distance from its true origin, but for what it
    /// `passes`.
    #[inline(always)]
    pub fn closest<B: Boxes>(
        &self,
        look: &Look,
        slabs: &Slabs,
        end: f32,
        passes: impl Fn(u32, &Crossing) -> bool,
    ) -> Option<Found> {
        let Look { sheared, offset, eye, .. } = look;
        let mut best: Option<(usize, u32, Crossing)> = None;
        let mut best_seen_at = end;
        self.hierarchy.walk::<true, B>(slabs, end - offset, |leaf, end| {
            let packet = &self.packets[leaf];
            let mut met = B::crossed(packet, sheared, *end);
            while met != 0 {
                let lane = met.trailing_zeros();
                met &= met - 1;
                if let Some(crossing) = sheared.cross(packet, lane as usize, *end) {
                    let black = !crossing.front && packet.two_sided >> lane & 1 == 0;
                    let t = crossing.t + offset;
                    let seen_at = if black { t * (1.0 + BACK_RECEDES) } else { t };
                    if seen_at < best_seen_at
                        && !(black && *eye == Eye::Camera)
                        && !passes(packet.triangles[lane as usize], &crossing)
                    {
                        best_seen_at = seen_at;
                        *end = seen_at - offset;
                        best = Some((leaf, lane, crossing));
                    }
                }
            }
            false
        });
        let (leaf, lane, crossing) = best?;
        Some(Found { leaf: leaf as u32, lane, crossing, seen_at: best_seen_at })
    }

    /// Whether a ray meets anything before `end`, a distance from its true origin, but for what it
    /// `passes`.
    #[inline(always)]
    pub fn blocked<B: Boxes>(
        &self,
        look: &Look,
        slabs: &Slabs,
        end: f32,
        passes: impl Fn(u32, &Crossing) -> bool,
    ) -> bool {
        let sheared = &look.sheared;
        let end = end - look.offset;
        self.hierarchy.walk::<false, B>(slabs, end, |leaf, _| {
            let packet = &self.packets[leaf];
            let mut met = B::crossed(packet, sheared, end);
            while met != 0 {
                let lane = met.trailing_zeros() as usize;
                met &= met - 1;
                if let Some(crossing) = sheared.cross(packet, lane, end)
                    && !passes(packet.triangles[lane], &crossing)
                {
                    return true;
                }
            }
            false
        })
    }
}
