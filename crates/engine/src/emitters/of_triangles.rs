//! A number for each of a few of a scene's triangles.

use crate::scene::Scene;
use std::collections::HashMap;

/// In place of the number of a triangle that has none.
const NONE: u32 = u32::MAX;

/// Numbers of triangles: a list of those that are listed in the scene, which are looked up fast, and
/// only those that have one of the many of instances.
pub struct OfTriangles {
    listed: Vec<u32>,
    of_instances: HashMap<u32, u32>,
}

impl OfTriangles {
    /// No triangle of the scene has a number.
    pub fn new(scene: &Scene) -> Self {
        Self { listed: vec![NONE; scene.triangles.len()], of_instances: HashMap::new() }
    }

    /// Gives a triangle a number below `u32::MAX`.
    pub fn set(&mut self, triangle: u32, number: u32) {
        match self.listed.get_mut(triangle as usize) {
            Some(own) => *own = number,
            None => drop(self.of_instances.insert(triangle, number)),
        }
    }

    /// The number of a triangle, if it has one.
    #[inline]
    pub fn of(&self, triangle: u32) -> Option<u32> {
        match self.listed.get(triangle as usize) {
            Some(number) => (*number != NONE).then_some(*number),
            None => self.of_instances.get(&triangle).copied(),
        }
    }
}
