//! Cameras: film position to ray.

use crate::math::{Ray, warp};
use glam::{Affine3A, Vec2, Vec3};

/// How depth shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// All lines of sight meet in the lens.
    Perspective,
    /// All are parallel. What the lens' settings say has no effect.
    Orthographic,
}

/// A camera: perspective, with a thin lens if `aperture_radius` > 0, or orthographic. Looks along local +z, x to the
/// *left* of the image as in Mitsuba.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Camera to world.
    pub to_world: Affine3A,
    /// How depth shows.
    pub projection: Projection,
    /// Half the width of the view in local units: of an orthographic one throughout, else at distance 1, which is
    /// tan(fov_x / 2).
    pub half_width: f32,
    /// Width over height of the full film.
    pub aspect: f32,
    /// Shift of the principal point, in fractions of the film.
    pub principal_offset: Vec2,
    /// Depths (along the optical axis) at which the view begins and ends: 0 and infinity unless the scene sets them.
    pub clip: (f32, f32),
    /// Lens radius; 0 is a pinhole.
    pub aperture_radius: f32,
    /// Depth of the plane in focus.
    pub focus_distance: f32,
}

/// What a field of view spans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FovAxis {
    /// The film's width.
    X,
    /// Its height.
    Y,
    /// Its diagonal.
    Diagonal,
    /// The smaller of width and height.
    Smaller,
    /// The larger of width and height.
    Larger,
}

impl Camera {
    /// A pinhole camera without clipping. `aspect` is the full film's width over its height.
    ///
    /// # Errors
    /// A message if the transform is singular or the field of view not between 0 and 180 degrees.
    pub fn perspective(
        to_world: Affine3A,
        fov_degrees: f32,
        axis: FovAxis,
        aspect: f32,
    ) -> Result<Camera, String> {
        if !(fov_degrees > 0.0 && fov_degrees < 180.0) {
            return Err(format!("the field of view must lie between 0 and 180 degrees, not {fov_degrees}"));
        }
        let camera = Camera::orthographic(to_world, aspect)?;
        let tan = (0.5 * fov_degrees as f64).to_radians().tan();
        let aspect64 = aspect as f64;
        let half_width = match axis {
            FovAxis::Diagonal => tan / (1.0 + 1.0 / (aspect64 * aspect64)).sqrt(),
            FovAxis::Y => tan * aspect64,
            FovAxis::Smaller if aspect > 1.0 => tan * aspect64,
            FovAxis::Larger if aspect <= 1.0 => tan * aspect64,
            FovAxis::X | FovAxis::Smaller | FovAxis::Larger => tan,
        };
        Ok(Camera { projection: Projection::Perspective, half_width: half_width as f32, ..camera })
    }

    /// An orthographic camera without clipping, which sees local −1 to 1 across the film's width.
    ///
    /// # Errors
    /// A message if the transform is singular.
    pub fn orthographic(to_world: Affine3A, aspect: f32) -> Result<Camera, String> {
        if !(aspect > 0.0 && aspect.is_finite()) {
            return Err(format!("the film's aspect ratio must be positive, not {aspect}"));
        }
        if !(to_world.is_finite() && to_world.inverse().is_finite()) {
            return Err("the camera's transformation is singular or not finite".into());
        }
        Ok(Camera {
            to_world,
            projection: Projection::Orthographic,
            half_width: 1.0,
            aspect,
            principal_offset: Vec2::ZERO,
            clip: (0.0, f32::INFINITY),
            aperture_radius: 0.0,
            focus_distance: 1.0,
        })
    }

    /// The ray through film position `film` ((0,0) top left, (1,1) bottom right of the full film) and lens sample
    /// `lens` in the unit square.
    pub fn ray(&self, film: Vec2, lens: Vec2) -> Ray {
        let plane = 1.0 - 2.0 * (film + self.principal_offset);
        let plane = plane * Vec2::new(self.half_width, self.half_width / self.aspect);
        let (o, d) = match self.projection {
            Projection::Orthographic => (plane.extend(0.0), Vec3::Z),
            Projection::Perspective => {
                let o = self.lens_point(lens);
                (o, plane.extend(1.0) - o / self.focus_distance)
            }
        };
        // The local direction advances the depth by 1, so its length in the world turns depths into distances.
        let d = self.to_world.transform_vector3(d);
        let per_depth = d.length();
        Ray {
            o: self.to_world.transform_point3(o),
            t_min: self.clip.0 * per_depth,
            d: d / per_depth,
            t_max: self.clip.1 * per_depth,
        }
    }

    /// The point of the lens that a sample names, local.
    fn lens_point(&self, lens: Vec2) -> Vec3 {
        match self.aperture_radius > 0.0 {
            true => (self.aperture_radius * warp::disk(lens)).extend(0.0),
            false => Vec3::ZERO,
        }
    }

    /// Film position of a point of the view's plane, at distance 1 if lines of sight meet.
    fn film(&self, plane: Vec2) -> Vec2 {
        let plane = Vec2::new(plane.x, plane.y * self.aspect) / self.half_width;
        0.5 * (1.0 - plane) - self.principal_offset
    }

    /// Where a world point appears on the film through the lens' centre; `None` behind the camera or clipped. The
    /// position may lie outside of the film.
    pub fn project(&self, p: Vec3) -> Option<Vec2> {
        let l = self.local(p)?;
        Some(self.film(match self.projection {
            Projection::Orthographic => l.truncate(),
            Projection::Perspective => l.truncate() / l.z,
        }))
    }

    /// A world point in camera coordinates; `None` behind the camera or clipped.
    fn local(&self, p: Vec3) -> Option<Vec3> {
        let l = self.to_world.inverse().transform_point3(p);
        (l.z > 0.0 && l.z >= self.clip.0 && l.z <= self.clip.1).then_some(l)
    }

    /// How a surface at `p` with unit normal `n` is seen through the lens point of the sample `lens`; `None` behind the
    /// camera or clipped.
    pub fn connect(&self, p: Vec3, n: Vec3, lens: Vec2) -> Option<Connection> {
        let l = self.local(p)?;
        // From the camera to the point, and where that meets the plane which the film is the picture of.
        let (o, plane) = match self.projection {
            Projection::Orthographic => (l.with_z(0.0), l.truncate()),
            Projection::Perspective => {
                let o = self.lens_point(lens);
                (o, ((l - o) / l.z + o / self.focus_distance).truncate())
            }
        };
        let o = self.to_world.transform_point3(o);
        // An area maps to (n·v)/det of its projection along v, the vector from the camera over its depth, and of that
        // the film sees 2·half_width each way, over the aspect ratio. Lines of sight that meet shrink it with the depth
        // squared.
        let view_area = 4.0 * self.half_width * self.half_width / self.aspect;
        let shrink = if self.projection == Projection::Perspective { l.z * l.z } else { 1.0 };
        let scale = self.to_world.matrix3.determinant() * l.z * shrink * view_area;
        Some(Connection { lens: o, film: self.film(plane), film_per_area: (n.dot(p - o) / scale).abs() })
    }
}

/// A surface point as the camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct Connection {
    /// The point on the lens, world; of an orthographic camera the foot of the line of sight.
    pub lens: Vec3,
    /// Film position, as for [`Camera::ray`]; it may lie outside of the film.
    pub film: Vec2,
    /// Area on the film, as a fraction of the full film, per area on the surface.
    pub film_per_area: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mitsuba 3's look_at(origin (1, 2, 3), target (−0.5, 0.3, 0.2), up (0.1, 1, 0.2)).
    fn pose() -> Affine3A {
        Affine3A::from_cols(
            glam::Vec3A::new(-0.879_643_56, -0.007_151_575_8, 0.475_579_65),
            glam::Vec3A::new(-0.229_964_26, 0.881_645_4, -0.412_089_6),
            glam::Vec3A::new(-0.416_345_54, -0.471_858_3, -0.777_178_35),
            glam::Vec3A::new(1.0, 2.0, 3.0),
        )
    }

    fn camera(axis: FovAxis) -> Camera {
        let mut c = Camera::perspective(pose(), 50.0, axis, 1.6).unwrap();
        c.clip = (0.5, 30.0);
        c
    }

    #[test]
    fn rays_are_those_of_mitsuba() {
        let shifted = Camera { principal_offset: Vec2::new(0.1, -0.2), ..camera(FovAxis::X) };
        let lens = Camera { aperture_radius: 0.2, focus_distance: 4.0, ..camera(FovAxis::X) };
        let mirrored = {
            let mut c = camera(FovAxis::X);
            c.to_world *= Affine3A::from_scale(Vec3::new(-1.0, 1.0, 1.0));
            c
        };
        // Mitsuba 3.9.1, `sample_ray` of a 320 × 200 film with fov 50, near 0.5 and far 30: camera, film and aperture
        // sample, origin (on the near plane), direction, maxt.
        type Row<'a> = (&'a Camera, [f32; 2], [f32; 2], [f32; 3], [f32; 3], f32);
        let (a, b) = ([0.1, 0.8], [0.95, 0.2]);
        let (la, lb) = ([0.3, 0.9], [0.7, 0.1]);
        #[rustfmt::skip]
        let table: [Row; 12] = [
            (&camera(FovAxis::X), a, la, [0.6478598, 1.6856524, 2.7361474], [-0.65117943, -0.5812933, -0.4879174], 31.9056),
            (&camera(FovAxis::X), b, lb, [0.95630383, 1.8426561, 2.475586], [-0.07955596, -0.28646985, -0.9547805], 32.405807),
            (&camera(FovAxis::Y), a, la, [0.56147933, 1.6386012, 2.8109894], [-0.73225784, -0.603477, -0.3156167], 35.3328),
            (&camera(FovAxis::Smaller), b, lb, [1.0549898, 1.8898073, 2.394091], [0.088937394, -0.17821938, -0.97996324], 36.479572),
            (&camera(FovAxis::Larger), b, lb, [0.95630383, 1.8426561, 2.475586], [-0.07955596, -0.28646985, -0.9547805], 32.405807),
            (&camera(FovAxis::Diagonal), b, lb, [0.9313031, 1.8307111, 2.4962316], [-0.12819605, -0.31591195, -0.9400881], 31.616552),
            (&shifted, a, la, [0.675474, 1.7373755, 2.6899507], [-0.62406623, -0.5050291, -0.5962272], 30.681093),
            (&shifted, b, lb, [0.983918, 1.8943794, 2.4293892], [-0.027702456, -0.18193935, -0.98291945], 34.25106),
            (&lens, a, la, [0.66524297, 1.8000704, 2.657367], [-0.64861786, -0.6048484, -0.4620102], 32.257496),
            (&lens, b, lb, [0.9389206, 1.7282382, 2.5543666], [-0.07419787, -0.25384745, -0.9643942], 32.771286),
            (&mirrored, a, la, [0.97600746, 1.6883202, 2.5587344], [-0.044367168, -0.57635987, -0.8159907], 31.9056),
            (&mirrored, b, lb, [0.5871379, 1.8396548, 2.6751757], [-0.7516821, -0.29193428, -0.59139526], 32.405807),
        ];
        for (i, (camera, film, lens, o, d, max_t)) in table.into_iter().enumerate() {
            let ray = camera.ray(Vec2::from(film), Vec2::from(lens));
            assert!(
                ray.at(ray.t_min).abs_diff_eq(Vec3::from(o), 2e-6),
                "{i}: origin {} is not {o:?}",
                ray.at(ray.t_min)
            );
            assert!(ray.d.abs_diff_eq(Vec3::from(d), 1e-6), "{i}: direction {} is not {d:?}", ray.d);
            assert!((ray.t_max - ray.t_min - max_t).abs() < 1e-4 * max_t, "{i}: length");
            if camera.aperture_radius == 0.0 {
                let seen = camera.project(ray.at(7.0)).unwrap();
                assert!(seen.abs_diff_eq(Vec2::from(film), 1e-5), "{i}: seen at {seen}");
            } else {
                let in_focus = ray.at(4.0 * ray.t_min / camera.clip.0);
                assert!(camera.project(in_focus).unwrap().abs_diff_eq(Vec2::from(film), 1e-5), "{i}: focus");
            }
        }
    }

    fn orthographic(scale: Vec3, aspect: f32) -> Camera {
        let camera = Camera::orthographic(pose() * Affine3A::from_scale(scale), aspect).unwrap();
        Camera { clip: (0.5, 30.0), ..camera }
    }

    #[test]
    fn orthographic_rays_are_those_of_mitsuba() {
        // Mitsuba 3.9.1, as above but orthographic, with a scale first: scale, film's aspect ratio, film sample, origin.
        #[rustfmt::skip]
        let table = [
            ([1.0, 1.0, 1.0], 1.6, [0.1, 0.8], [0.174349, 1.427733, 3.146408]),
            ([1.0, 1.0, 1.0], 1.6, [0.95, 0.2], [1.49727, 2.101124, 2.028856]),
            ([2.0, 3.0, 1.0], 1.6, [0.1, 0.8], [-0.3568927, 0.7607776, 3.835939]),
            ([2.0, 3.0, 1.0], 1.6, [0.95, 0.2], [2.116475, 2.768795, 1.291767]),
            ([-1.0, 1.5, 2.0], 0.625, [0.1, 0.8], [1.618518, 0.2642942, 2.435767]),
            ([-1.0, 1.5, 2.0], 0.625, [0.95, 0.2], [-0.539173, 2.791275, 2.057434]),
        ];
        for (scale, aspect, film, o) in table {
            let camera = orthographic(Vec3::from(scale), aspect);
            let ray = camera.ray(Vec2::from(film), Vec2::ZERO);
            let near = ray.at(ray.t_min);
            assert!(near.abs_diff_eq(Vec3::from(o), 3e-6), "{scale:?}: origin {near} is not {o:?}");
            assert!(ray.d.abs_diff_eq(Vec3::new(-0.4163455, -0.4718583, -0.7771783), 1e-6));
            assert!((ray.t_max - ray.t_min - 29.5 * scale[2]).abs() < 1e-4);
            let seen = camera.project(ray.at(7.0)).unwrap();
            assert!(seen.abs_diff_eq(Vec2::from(film), 1e-5), "{scale:?}: seen at {seen}");
        }
        assert!(Camera::orthographic(Affine3A::from_scale(Vec3::ZERO), 1.0).is_err());
        assert!(Camera::orthographic(pose(), 0.0).is_err());
        assert!(orthographic(Vec3::ONE, 1.0).project(pose().transform_point3(-Vec3::Z)).is_none());
    }

    #[test]
    fn scale_in_the_transform_changes_no_direction() {
        let scaled =
            Camera { to_world: pose() * Affine3A::from_scale(Vec3::splat(2.0)), ..camera(FovAxis::X) };
        let (a, b) = (
            scaled.ray(Vec2::new(0.2, 0.7), Vec2::ZERO),
            camera(FovAxis::X).ray(Vec2::new(0.2, 0.7), Vec2::ZERO),
        );
        assert!(a.d.abs_diff_eq(b.d, 1e-6));
        assert!((a.t_min / b.t_min - 2.0).abs() < 1e-5);
    }

    /// A point of the ray through a film position is seen there; the film's area per surface area is that of the
    /// parallelogram that two small steps on the surface make on the film.
    #[test]
    fn connections_are_rays_backwards() {
        let shift = Vec2::new(0.1, -0.2);
        let scaled = pose() * Affine3A::from_scale(Vec3::splat(2.5));
        let cameras = [
            Camera { principal_offset: shift, ..camera(FovAxis::Y) },
            Camera { aperture_radius: 0.2, focus_distance: 4.0, ..camera(FovAxis::X) },
            Camera { aperture_radius: 0.3, focus_distance: 2.0, to_world: scaled, ..camera(FovAxis::X) },
            orthographic(Vec3::ONE, 1.6),
            orthographic(Vec3::new(-3.0, 2.0, 1.5), 0.7),
        ];
        for camera in cameras {
            for (film, lens) in
                [([0.1, 0.8], [0.3, 0.9]), ([0.95, 0.2], [0.7, 0.1]), ([0.5, 0.5], [0.1, 0.4])]
            {
                let (film, lens) = (Vec2::from(film), Vec2::from(lens));
                let ray = camera.ray(film, lens);
                let p = ray.at(6.0);
                let n = Vec3::new(0.48, -0.6, 0.64);
                let seen = camera.connect(p, n, lens).unwrap();
                assert!(seen.lens.abs_diff_eq(ray.o, 1e-5), "{} {}", seen.lens, ray.o);
                assert!(seen.film.abs_diff_eq(film, 1e-5), "{} {film}", seen.film);
                let (s, t) = n.any_orthonormal_pair();
                let step = |d: Vec3| {
                    let film = |h: f32| camera.connect(p + d * h, n, lens).unwrap().film;
                    (film(0.02) - film(-0.02)) / 0.04
                };
                let area = step(s).perp_dot(step(t)).abs();
                assert!((seen.film_per_area / area - 1.0).abs() < 2e-3, "{} {area}", seen.film_per_area);
            }
        }
        assert!(camera(FovAxis::X).connect(pose().transform_point3(-Vec3::Z), Vec3::Z, Vec2::ZERO).is_none());
    }

    #[test]
    fn nonsense_is_refused_and_the_unseen_not_projected() {
        let make = |m, fov, aspect| Camera::perspective(m, fov, FovAxis::X, aspect);
        assert!(make(Affine3A::from_scale(Vec3::new(1.0, 1.0, 0.0)), 50.0, 1.0).is_err());
        for fov in [0.0, 180.0, -1.0, f32::NAN] {
            assert!(make(Affine3A::IDENTITY, fov, 1.0).is_err());
        }
        assert!(make(Affine3A::IDENTITY, 50.0, 0.0).is_err());
        let mut c = make(Affine3A::IDENTITY, 50.0, 1.0).unwrap();
        assert!(
            c.project(Vec3::Z).is_some() && c.project(-Vec3::Z).is_none() && c.project(Vec3::X).is_none()
        );
        c.clip = (2.0, 3.0);
        assert!(c.project(Vec3::Z).is_none() && c.project(4.0 * Vec3::Z).is_none());
    }
}
