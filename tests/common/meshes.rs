//! Meshes made by formula.
#![allow(dead_code, unreachable_pub)] // each user takes a part

use glam::Vec3;
use std::collections::HashMap;

/// Vertices, and triangles of them.
pub(crate) type Triangles = (Vec<Vec3>, Vec<[u32; 3]>);

/// A closed surface like a scan's, of 20·4^`level` triangles around the origin: an icosphere whose vertices are drawn
/// together towards some directions, so that sizes and shapes of triangles vary, with bumps of all sizes. Every point
/// within half a unit of the origin is inside.
pub(crate) fn organic(level: u32) -> Triangles {
    let (mut points, mut triangles) = icosahedron();
    for _ in 0..level {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a as usize] + points[b as usize]).normalize());
                points.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [d, e, f] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
            })
            .collect();
    }
    let place = |p: Vec3| {
        // Flows along the sphere, weakly enough to stay one to one.
        let mut d = p;
        for k in [2.0, 5.0] {
            let wave = Vec3::new((k * d.y).sin(), (k * d.z + 1.0).sin(), (k * d.x + 2.0).sin());
            d = (d + wave * 0.35 / k).normalize();
        }
        let mut radius = 1.0;
        for octave in 0..6 {
            let k = 3.0 * 2.1f32.powi(octave);
            let q = d * k + octave as f32;
            radius += 0.12 * 0.5f32.powi(octave) * (q.x.sin() * q.y.cos() + (q.y * 1.3).sin() * q.z.cos());
        }
        d * radius
    };
    (points.into_iter().map(place).collect(), triangles)
}

fn icosahedron() -> Triangles {
    let g = (1.0 + 5f32.sqrt()) / 2.0;
    let corners = [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)];
    let points = corners
        .map(|(a, b)| Vec3::new(a, b, 0.0))
        .into_iter()
        .chain(corners.map(|(a, b)| Vec3::new(0.0, a, b)))
        .chain(corners.map(|(a, b)| Vec3::new(b, 0.0, a)))
        .map(Vec3::normalize)
        .collect();
    let triangles = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    (points, triangles)
}

/// `n` needles in random directions, a thousand times as long as wide.
pub(crate) fn needles(n: u32, mut random: impl FnMut() -> f32) -> Triangles {
    let mut point = || Vec3::new(random(), random(), random()) * 2.0 - 1.0;
    let (mut points, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..n {
        let (start, along, across) = (point(), point(), point());
        points.extend([start, start + along, start + along + across * 1e-3]);
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    (points, triangles)
}
