//! Ray tracing by the system's Embree 4 or 3. All its `unsafe` lives here, behind handles that release themselves.
//!
//! Shape `i` becomes the geometry with id `i`. Meshes are copied; analytic shapes are user geometries that call
//! [`Shape::intersect`], as the other backend does, so that both find the same hits. Thin triangles of all meshes go
//! into one more geometry, whose hits are checked in f64: Embree computes distances from the f32 cross product of the
//! edges, and for thin triangles that is off by more than rays are moved off surfaces.

#![allow(unsafe_code)]

use super::Intersector;
use crate::math::Ray;
use crate::shape::{Geometry, Hit, Mesh, Shape};
use crate::{Error, Result};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ffi::c_void;
use std::ptr;

/// The installed header, by bindgen.
#[allow(clippy::all, missing_docs, non_camel_case_types, non_snake_case, non_upper_case_globals)]
#[allow(clippy::undocumented_unsafe_blocks, dead_code, unreachable_pub)]
mod ffi {
    include!(concat!(env!("OUT_DIR"), "/embree.rs"));
}
use ffi::*;

/// `RTC_INVALID_GEOMETRY_ID`, a cast that bindgen does not translate.
const INVALID: u32 = u32::MAX;
const LEVELS: usize = RTC_MAX_INSTANCE_LEVEL_COUNT as usize;

/// A committed Embree scene.
pub(super) struct Embree {
    scene: Scene,
    /// User geometries point here, so it lives as long as the scene and its items never move.
    _quadrics: Vec<Shape>,
    /// As above, for the filter.
    thin: Vec<Thin>,
    /// Id of the geometry of thin triangles.
    thin_id: u32,
    _device: Device,
}

// SAFETY: queries are Embree's thread-safe part, and nothing else happens to a committed scene.
unsafe impl Send for Embree {}
// SAFETY: as above; the callbacks only read.
unsafe impl Sync for Embree {}

impl Embree {
    /// Builds and commits the scene; indices must have been checked. Embree uses threads of its own.
    pub(super) fn new(geometry: &Geometry) -> Result<Embree> {
        let device = Device::new()?;
        // SAFETY: the device is valid; the result is checked.
        let scene = Scene(device.not_null(unsafe { rtcNewScene(device.0) }, "creating a scene")?);
        // SAFETY: the scene is valid. Robust: no ray slips through shared edges.
        unsafe { rtcSetSceneFlags(scene.0, RTC_SCENE_FLAG_ROBUST) };

        // Complete before Embree gets pointers to their items.
        let is_quadric = |s: &&Shape| !matches!(s, Shape::Mesh(_));
        let quadrics: Vec<Shape> = geometry.shapes.iter().filter(is_quadric).cloned().collect();
        let thin = Thin::all(geometry);
        let thin_id = geometry.shapes.len() as u32;

        let mut next_quadric = quadrics.iter();
        for (id, shape) in geometry.shapes.iter().enumerate() {
            let part = match shape {
                Shape::Mesh(mesh) if mesh.triangles.is_empty() => continue,
                Shape::Mesh(mesh) => {
                    let of_mesh = |t: &Thin| t.shape.cmp(&(id as u32));
                    let start = thin.partition_point(|t| of_mesh(t).is_lt());
                    let end = thin.partition_point(|t| of_mesh(t).is_le());
                    device.mesh(mesh, &thin[start..end])?
                }
                _ => match next_quadric.next() {
                    Some(quadric) => device.quadric(quadric)?,
                    None => continue,
                },
            };
            scene.attach(&part, id as u32);
        }
        if !thin.is_empty() {
            scene.attach(&device.thin(&thin)?, thin_id);
        }
        device.check("copying the geometry")?;
        // SAFETY: the scene is valid and not yet shared.
        unsafe { rtcCommitScene(scene.0) };
        device.check("building the scene")?;
        Ok(Embree { scene, _quadrics: quadrics, thin, thin_id, _device: device })
    }
}

impl Intersector for Embree {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !super::is_valid(ray) {
            return None;
        }
        let hit = RTCHit { geomID: INVALID, instID: [INVALID; LEVELS], ..Default::default() };
        let mut query = RTCRayHit { ray: rtc_ray(ray), hit };
        // SAFETY: the scene is committed and alive, the query valid and aligned.
        unsafe {
            #[cfg(embree = "4")]
            rtcIntersect1(self.scene.0, &mut query, ptr::null_mut());
            #[cfg(embree = "3")]
            rtcIntersect1(self.scene.0, &mut context(), &mut query);
        }
        let RTCRayHit { ray: end, hit } = query;
        // Embree compares distances before it divides; rounding must not carry the quotient out of the range.
        let t = end.tfar.max(above(ray.t_min)).min(below(ray.t_max));
        let (shape, primitive) = match hit.geomID {
            INVALID => return None,
            id if id == self.thin_id => self.thin.get(hit.primID as usize).map(|t| (t.shape, t.primitive))?,
            id => (id, hit.primID),
        };
        Some(Hit { t, u: hit.u, v: hit.v, shape, primitive })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        if !super::is_valid(ray) {
            return false;
        }
        let mut query = rtc_ray(ray);
        // SAFETY: the scene is committed and alive, the query valid and aligned.
        unsafe {
            #[cfg(embree = "4")]
            rtcOccluded1(self.scene.0, &mut query, ptr::null_mut());
            #[cfg(embree = "3")]
            rtcOccluded1(self.scene.0, &mut context(), &mut query);
        }
        // What Embree sets for an occluded ray.
        query.tfar == f32::NEG_INFINITY
    }
}

/// Embree counts hits at `tfar` itself, we don't.
fn rtc_ray(ray: &Ray) -> RTCRay {
    let mut query = RTCRay { tfar: below(ray.t_max), mask: u32::MAX, ..Default::default() };
    // One 16-byte store each: Embree loads them so, and would wait for smaller stores to retire.
    // SAFETY: the struct is aligned to 16 bytes and begins with org_x, org_y, org_z, tnear, dir_x, dir_y, dir_z, time.
    unsafe {
        let start = (&raw mut query).cast::<Vec4>();
        start.write(ray.o.extend(ray.t_min));
        start.add(1).write(ray.d.extend(0.0));
    }
    query
}

/// The next smaller number, of a positive one.
fn below(x: f32) -> f32 {
    f32::from_bits(x.to_bits().wrapping_sub(1))
}

/// The next larger number, of a finite one that is not negative.
fn above(x: f32) -> f32 {
    f32::from_bits(x.to_bits().wrapping_add(1))
}

/// `rtcInitIntersectContext`, an inline function that bindgen cannot see.
#[cfg(embree = "3")]
#[allow(clippy::needless_update)] // Builds of Embree with more instance levels have more fields.
fn context() -> RTCIntersectContext {
    let incoherent = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    RTCIntersectContext { flags: incoherent, filter: None, instID: [INVALID; LEVELS], ..Default::default() }
}

struct Device(RTCDevice);
struct Scene(RTCScene);
struct Part(RTCGeometry);

impl Scene {
    fn attach(&self, part: &Part, id: u32) {
        // SAFETY: both handles are valid; the scene takes its own reference.
        unsafe {
            rtcCommitGeometry(part.0);
            rtcAttachGeometryByID(self.0, part.0, id);
        }
    }
}

/// A triangle too thin for Embree's own distances.
struct Thin {
    vertices: [Vec3; 3],
    shape: u32,
    primitive: u32,
}

impl Thin {
    /// By shape and triangle, ascending.
    fn all(geometry: &Geometry) -> Vec<Thin> {
        let of_shape = |(shape, s): (usize, &Shape)| match s {
            Shape::Mesh(mesh) => (0..mesh.triangles.len() as u32)
                .into_par_iter()
                .map(|t| Thin { vertices: mesh.vertices(t), shape: shape as u32, primitive: t })
                .filter(|t| is_thin(t.vertices))
                .collect(),
            _ => Vec::new(),
        };
        geometry.shapes.iter().enumerate().flat_map(of_shape).collect()
    }
}

/// Whether a triangle is so thin that Embree's distances are not good enough: rays moved off their surface by
/// [`crate::math::offset_origin`] were seen to hit it again from a length/height of 230 on.
fn is_thin([a, b, c]: [Vec3; 3]) -> bool {
    let (e, f) = (b - a, c - a);
    e.length_squared().max(f.length_squared()) > 64.0 * e.cross(f).length()
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: valid, and ours to release once.
        unsafe { rtcReleaseDevice(self.0) }
    }
}

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: valid, and ours to release once.
        unsafe { rtcReleaseScene(self.0) }
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // SAFETY: valid, and ours to release once.
        unsafe { rtcReleaseGeometry(self.0) }
    }
}

impl Device {
    fn new() -> Result<Device> {
        // The default number of threads, whatever number renders: the tree, and which of two coinciding triangles is
        // hit, may depend on it.
        // SAFETY: no configuration string is allowed.
        let device = unsafe { rtcNewDevice(ptr::null()) };
        if device.is_null() {
            // SAFETY: without a device, it is the thread's own error.
            return Err(failed("starting", unsafe { rtcGetDeviceError(ptr::null_mut()) }));
        }
        Ok(Device(device))
    }

    /// The first error since the last check.
    fn check(&self, doing: &str) -> Result<()> {
        // SAFETY: the device is valid.
        match unsafe { rtcGetDeviceError(self.0) } {
            RTC_ERROR_NONE => Ok(()),
            code => Err(failed(doing, code)),
        }
    }

    fn not_null<T>(&self, p: *mut T, doing: &str) -> Result<*mut T> {
        if p.is_null() {
            Err(self.check(doing).err().unwrap_or_else(|| failed(doing, RTC_ERROR_UNKNOWN)))
        } else {
            Ok(p)
        }
    }

    fn part(&self, kind: RTCGeometryType) -> Result<Part> {
        // SAFETY: the device is valid; the result is checked.
        Ok(Part(self.not_null(unsafe { rtcNewGeometry(self.0, kind) }, "creating a geometry")?))
    }

    /// All triangles but the thin ones, in whose place stands a point.
    fn mesh(&self, mesh: &Mesh, thin: &[Thin]) -> Result<Part> {
        let mut triangles = Cow::Borrowed(&mesh.triangles);
        for t in thin {
            let corners = &mut triangles.to_mut()[t.primitive as usize];
            *corners = [corners[0]; 3];
        }
        let part = self.part(RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.copy(&part, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, &mesh.positions)?;
        self.copy(&part, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, &triangles)?;
        Ok(part)
    }

    /// The geometry refers to `thin` for as long as its scene lives.
    fn thin(&self, thin: &[Thin]) -> Result<Part> {
        let positions: Vec<Vec3> = thin.iter().flat_map(|t| t.vertices).collect();
        let triangles: Vec<[u32; 3]> =
            (0..thin.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let part = self.part(RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.copy(&part, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, &positions)?;
        self.copy(&part, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, &triangles)?;
        // SAFETY: the geometry is valid, and the callback gets the pointer that it expects.
        unsafe {
            rtcSetGeometryUserData(part.0, thin.as_ptr().cast_mut().cast::<c_void>());
            rtcSetGeometryIntersectFilterFunction(part.0, Some(thin_filter));
            rtcSetGeometryOccludedFilterFunction(part.0, Some(thin_filter));
        }
        Ok(part)
    }

    /// Copies into a buffer that Embree allocates, which keeps its padding rules and our lifetimes apart.
    fn copy<T: Copy>(&self, part: &Part, kind: RTCBufferType, format: RTCFormat, from: &[T]) -> Result<()> {
        const { assert!(size_of::<T>() == 12) };
        // SAFETY: the geometry is valid; the result is checked.
        let to = unsafe { rtcSetNewGeometryBuffer(part.0, kind, 0, format, size_of::<T>(), from.len()) };
        let to = self.not_null(to, "allocating a mesh")?.cast::<T>();
        // SAFETY: the new buffer holds as many items of this size, and overlaps nothing of ours.
        unsafe { ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
        Ok(())
    }

    /// The geometry refers to `quadric` for as long as its scene lives.
    fn quadric(&self, quadric: &Shape) -> Result<Part> {
        let part = self.part(RTC_GEOMETRY_TYPE_USER)?;
        // SAFETY: the geometry is valid, and the callbacks get the pointer that they expect.
        unsafe {
            rtcSetGeometryUserPrimitiveCount(part.0, 1);
            rtcSetGeometryUserData(part.0, ptr::from_ref(quadric).cast_mut().cast::<c_void>());
            rtcSetGeometryBoundsFunction(part.0, Some(quadric_bounds), ptr::null_mut());
            rtcSetGeometryIntersectFunction(part.0, Some(quadric_intersect));
            rtcSetGeometryOccludedFunction(part.0, Some(quadric_occluded));
        }
        Ok(part)
    }
}

fn failed(doing: &str, code: RTCError) -> Error {
    let what = match code {
        RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        RTC_ERROR_INVALID_OPERATION => "invalid operation",
        RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        RTC_ERROR_UNSUPPORTED_CPU => "this CPU is not supported",
        RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    };
    Error::Runtime(format!("Embree failed while {doing}: {what}"))
}

// The callbacks below cannot panic: they only do arithmetic.

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::quadric`].
unsafe extern "C" fn quadric_bounds(args: *const RTCBoundsFunctionArguments) {
    // SAFETY: see above.
    unsafe {
        let b = (*(*args).geometryUserPtr.cast::<Shape>()).bounds();
        let out = &mut *(*args).bounds_o;
        (out.lower_x, out.lower_y, out.lower_z) = b.min.into();
        (out.upper_x, out.upper_y, out.upper_z) = b.max.into();
    }
}

fn our_ray(r: &RTCRay) -> Ray {
    let (o, d) = (Vec3::new(r.org_x, r.org_y, r.org_z), Vec3::new(r.dir_x, r.dir_y, r.dir_z));
    // Embree counts hits at `tfar` itself.
    Ray { o, t_min: r.tnear, d, t_max: above(r.tfar) }
}

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::quadric`].
unsafe extern "C" fn quadric_intersect(args: *const RTCIntersectFunctionNArguments) {
    // SAFETY: see above; for queries of one ray the packet is a plain RTCRayHit, and active.
    unsafe {
        let args = &*args;
        let query = &mut *args.rayhit.cast::<RTCRayHit>();
        if let Some(t) = (*args.geometryUserPtr.cast::<Shape>()).intersect(&our_ray(&query.ray)) {
            query.ray.tfar = t;
            query.hit = RTCHit {
                geomID: args.geomID,
                primID: args.primID,
                instID: [INVALID; LEVELS],
                ..Default::default()
            };
        }
    }
}

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::quadric`].
unsafe extern "C" fn quadric_occluded(args: *const RTCOccludedFunctionNArguments) {
    // SAFETY: see above; for queries of one ray the packet is a plain RTCRay, and active.
    unsafe {
        let args = &*args;
        let ray = &mut *args.ray.cast::<RTCRay>();
        if (*args.geometryUserPtr.cast::<Shape>()).intersect(&our_ray(ray)).is_some() {
            ray.tfar = f32::NEG_INFINITY;
        }
    }
}

/// Rejects hits that are not there, or far off.
///
/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::thin`].
unsafe extern "C" fn thin_filter(args: *const RTCFilterFunctionNArguments) {
    // SAFETY: see above; for queries of one ray the packets are a plain RTCRay and RTCHit, and the triangle's index is
    // one of those that the geometry was made of.
    unsafe {
        let args = &*args;
        let (ray, hit) = (&*args.ray.cast::<RTCRay>(), &*args.hit.cast::<RTCHit>());
        let thin = &*args.geometryUserPtr.cast::<Thin>().add(hit.primID as usize);
        let t = super::plane_distance(&thin.vertices, &our_ray(ray));
        // Here `tfar` is the distance of this hit.
        if !(t > ray.tnear && (t - ray.tfar).abs() <= t / 16.0) {
            *args.valid = 0;
        }
    }
}
