//! Ray tracing by the system's Embree 4 or 3. All its `unsafe` lives here, behind handles that release themselves.
//!
//! The shapes of the world are one Embree scene, those of each group another. Shape `i` of them becomes the geometry with
//! id `i`. Meshes are copied; analytic shapes are user geometries that call [`Shape::intersect`], as the other backend
//! does, so that both find the same hits. Thin triangles of all meshes go into one more geometry, whose hits are checked
//! in f64: Embree computes distances from the f32 cross product of the edges, and for thin triangles that is off by more
//! than rays are moved off surfaces.
//!
//! All instances are the primitives of one user geometry, not instances of Embree's: those would each be a geometry, and
//! bring rays into their groups in f32, whose rounding grows with how far and how unevenly they stretch and move.

#![allow(unsafe_code)]

use super::Intersector;
use crate::math::Ray;
use crate::shape::{Bounds, Geometry, Hit, Instance, Mesh, Shape};
use crate::{Error, Result};
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ffi::c_void;
use std::ops::Range;
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

/// The world, committed.
pub(super) struct Embree {
    world: Part,
    placed: Box<Placed>,
    _device: Device,
}

// SAFETY: queries are Embree's thread-safe part, and nothing else happens to a committed scene.
unsafe impl Send for Embree {}
// SAFETY: as above; the callbacks only read.
unsafe impl Sync for Embree {}

/// What user geometries of the world point to, so it lives as long as that, and never moves.
struct Placed {
    instances: Vec<Instance>,
    bounds: Vec<Bounds>,
    groups: Vec<Part>,
}

/// The shapes of the world or of a group as an Embree scene.
struct Part {
    scene: Scene,
    /// Index of the shape with id 0.
    first: u32,
    /// User geometries point here, so it lives as long as the scene and its items never move.
    _quadrics: Vec<Shape>,
    /// As above, for the filter.
    thin: Vec<Thin>,
    /// Id of the geometry of thin triangles.
    thin_id: u32,
}

impl Embree {
    /// Builds and commits the scenes; indices must have been checked. Embree uses threads of its own.
    pub(super) fn new(geometry: &Geometry) -> Result<Embree> {
        let device = Device::new()?;
        let group = |(group, range): (u32, &Range<u32>)| {
            let part = Part::new(&device, geometry.group(group), range.start)?;
            part.commit(&device)?;
            Ok(part)
        };
        let placed = Box::new(Placed {
            instances: geometry.instances.clone(),
            bounds: geometry.instance_bounds(),
            groups: (0..).zip(&geometry.groups).map(group).collect::<Result<_>>()?,
        });
        let world = Part::new(&device, geometry.world(), 0)?;
        if !placed.instances.is_empty() {
            world.scene.attach(&device.instances(&placed)?, world.thin_id + 1);
        }
        world.commit(&device)?;
        Ok(Embree { world, placed, _device: device })
    }
}

impl Part {
    /// Still to be committed.
    fn new(device: &Device, shapes: &[Shape], first: u32) -> Result<Part> {
        // SAFETY: the device is valid; the result is checked.
        let scene = Scene(device.not_null(unsafe { rtcNewScene(device.0) }, "creating a scene")?);
        // SAFETY: the scene is valid. Robust: no ray slips through shared edges.
        unsafe { rtcSetSceneFlags(scene.0, RTC_SCENE_FLAG_ROBUST) };

        // Complete before Embree gets pointers to their items.
        let is_quadric = |s: &&Shape| !matches!(s, Shape::Mesh(_));
        let quadrics: Vec<Shape> = shapes.iter().filter(is_quadric).cloned().collect();
        let thin = Thin::all(shapes);
        let thin_id = shapes.len() as u32;

        let mut next_quadric = quadrics.iter();
        for (id, shape) in shapes.iter().enumerate() {
            let attached = match shape {
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
            scene.attach(&attached, id as u32);
        }
        if !thin.is_empty() {
            scene.attach(&device.thin(&thin)?, thin_id);
        }
        Ok(Part { scene, first, _quadrics: quadrics, thin, thin_id })
    }

    fn commit(&self, device: &Device) -> Result<()> {
        device.check("copying the geometry")?;
        // SAFETY: the scene is valid and not yet shared.
        unsafe { rtcCommitScene(self.scene.0) };
        device.check("building the scene")
    }

    /// Shape and primitive.
    fn identify(&self, hit: &RTCHit) -> Option<(u32, u32)> {
        let (shape, primitive) = match hit.geomID {
            id if id == self.thin_id => self.thin.get(hit.primID as usize).map(|t| (t.shape, t.primitive))?,
            id => (id, hit.primID),
        };
        Some((self.first + shape, primitive))
    }
}

impl Intersector for Embree {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        if !super::is_valid(ray) {
            return None;
        }
        let RTCRayHit { ray: end, hit } = self.world.scene.nearest(rtc_ray(ray));
        if hit.geomID == INVALID {
            return None;
        }
        // Embree compares distances before it divides; rounding must not carry the quotient out of the range.
        let t = end.tfar.max(above(ray.t_min)).min(below(ray.t_max));
        let instance = hit.instID[0];
        let part = match self.placed.instances.get(instance as usize) {
            Some(instance) => &self.placed.groups[instance.group as usize],
            None => &self.world,
        };
        let (shape, primitive) = part.identify(&hit)?;
        Some(Hit { t, u: hit.u, v: hit.v, shape, primitive, instance })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        super::is_valid(ray) && self.world.scene.any(rtc_ray(ray))
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
struct Attached(RTCGeometry);

impl Scene {
    fn attach(&self, geometry: &Attached, id: u32) {
        // SAFETY: both handles are valid; the scene takes its own reference.
        unsafe {
            rtcCommitGeometry(geometry.0);
            rtcAttachGeometryByID(self.0, geometry.0, id);
        }
    }

    /// The nearest hit in the scene, which is committed.
    fn nearest(&self, ray: RTCRay) -> RTCRayHit {
        let hit = RTCHit { geomID: INVALID, instID: [INVALID; LEVELS], ..Default::default() };
        let mut query = RTCRayHit { ray, hit };
        // SAFETY: the scene is committed and alive, the query valid and aligned.
        unsafe {
            #[cfg(embree = "4")]
            rtcIntersect1(self.0, &mut query, ptr::null_mut());
            #[cfg(embree = "3")]
            rtcIntersect1(self.0, &mut context(), &mut query);
        }
        query
    }

    /// Whether anything of the scene, which is committed, lies on the ray.
    fn any(&self, mut ray: RTCRay) -> bool {
        // SAFETY: the scene is committed and alive, the query valid and aligned.
        unsafe {
            #[cfg(embree = "4")]
            rtcOccluded1(self.0, &mut ray, ptr::null_mut());
            #[cfg(embree = "3")]
            rtcOccluded1(self.0, &mut context(), &mut ray);
        }
        // What Embree sets for an occluded ray.
        ray.tfar == f32::NEG_INFINITY
    }
}

/// A triangle too thin for Embree's own distances.
struct Thin {
    vertices: [Vec3; 3],
    shape: u32,
    primitive: u32,
}

impl Thin {
    /// By shape and triangle, ascending; of a group, counted from its first.
    fn all(shapes: &[Shape]) -> Vec<Thin> {
        let of_shape = |(shape, s): (usize, &Shape)| match s {
            Shape::Mesh(mesh) => (0..mesh.triangles.len() as u32)
                .into_par_iter()
                .map(|t| Thin { vertices: mesh.vertices(t), shape: shape as u32, primitive: t })
                .filter(|t| is_thin(t.vertices))
                .collect(),
            _ => Vec::new(),
        };
        shapes.iter().enumerate().flat_map(of_shape).collect()
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

impl Drop for Attached {
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

    fn geometry(&self, kind: RTCGeometryType) -> Result<Attached> {
        // SAFETY: the device is valid; the result is checked.
        Ok(Attached(self.not_null(unsafe { rtcNewGeometry(self.0, kind) }, "creating a geometry")?))
    }

    /// All triangles but the thin ones, in whose place stands a point.
    fn mesh(&self, mesh: &Mesh, thin: &[Thin]) -> Result<Attached> {
        let mut triangles = Cow::Borrowed(&mesh.triangles);
        for t in thin {
            let corners = &mut triangles.to_mut()[t.primitive as usize];
            *corners = [corners[0]; 3];
        }
        let geometry = self.geometry(RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.copy(&geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, &mesh.positions)?;
        self.copy(&geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, &triangles)?;
        Ok(geometry)
    }

    /// The geometry refers to `thin` for as long as its scene lives.
    fn thin(&self, thin: &[Thin]) -> Result<Attached> {
        let positions: Vec<Vec3> = thin.iter().flat_map(|t| t.vertices).collect();
        let triangles: Vec<[u32; 3]> =
            (0..thin.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let geometry = self.geometry(RTC_GEOMETRY_TYPE_TRIANGLE)?;
        self.copy(&geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, &positions)?;
        self.copy(&geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, &triangles)?;
        // SAFETY: the geometry is valid, and the callback gets the pointer that it expects.
        unsafe {
            rtcSetGeometryUserData(geometry.0, thin.as_ptr().cast_mut().cast::<c_void>());
            rtcSetGeometryIntersectFilterFunction(geometry.0, Some(thin_filter));
            rtcSetGeometryOccludedFilterFunction(geometry.0, Some(thin_filter));
        }
        Ok(geometry)
    }

    /// Copies into a buffer that Embree allocates, which keeps its padding rules and our lifetimes apart.
    fn copy<T: Copy>(
        &self,
        geometry: &Attached,
        kind: RTCBufferType,
        format: RTCFormat,
        from: &[T],
    ) -> Result<()> {
        const { assert!(size_of::<T>() == 12) };
        // SAFETY: the geometry is valid; the result is checked.
        let to = unsafe { rtcSetNewGeometryBuffer(geometry.0, kind, 0, format, size_of::<T>(), from.len()) };
        let to = self.not_null(to, "allocating a mesh")?.cast::<T>();
        // SAFETY: the new buffer holds as many items of this size, and overlaps nothing of ours.
        unsafe { ptr::copy_nonoverlapping(from.as_ptr(), to, from.len()) };
        Ok(())
    }

    /// The geometry refers to `quadric` for as long as its scene lives.
    fn quadric(&self, quadric: &Shape) -> Result<Attached> {
        let geometry = self.geometry(RTC_GEOMETRY_TYPE_USER)?;
        // SAFETY: the geometry is valid, and the callbacks get the pointer that they expect.
        unsafe {
            rtcSetGeometryUserPrimitiveCount(geometry.0, 1);
            rtcSetGeometryUserData(geometry.0, ptr::from_ref(quadric).cast_mut().cast::<c_void>());
            rtcSetGeometryBoundsFunction(geometry.0, Some(quadric_bounds), ptr::null_mut());
            rtcSetGeometryIntersectFunction(geometry.0, Some(quadric_intersect));
            rtcSetGeometryOccludedFunction(geometry.0, Some(quadric_occluded));
        }
        Ok(geometry)
    }

    /// The geometry refers to `placed` for as long as its scene lives.
    fn instances(&self, placed: &Placed) -> Result<Attached> {
        let geometry = self.geometry(RTC_GEOMETRY_TYPE_USER)?;
        // SAFETY: the geometry is valid, and the callbacks get the pointer that they expect.
        unsafe {
            rtcSetGeometryUserPrimitiveCount(geometry.0, placed.instances.len() as u32);
            rtcSetGeometryUserData(geometry.0, ptr::from_ref(placed).cast_mut().cast::<c_void>());
            rtcSetGeometryBoundsFunction(geometry.0, Some(instance_bounds), ptr::null_mut());
            rtcSetGeometryIntersectFunction(geometry.0, Some(instance_intersect));
            rtcSetGeometryOccludedFunction(geometry.0, Some(instance_occluded));
        }
        Ok(geometry)
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

// The callbacks below cannot panic: they only do arithmetic, and look up instances and groups by checked indices.

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::quadric`].
unsafe extern "C" fn quadric_bounds(args: *const RTCBoundsFunctionArguments) {
    // SAFETY: see above.
    unsafe {
        *(*args).bounds_o = rtc_bounds((*(*args).geometryUserPtr.cast::<Shape>()).bounds());
    }
}

fn rtc_bounds(Bounds { min, max }: Bounds) -> RTCBounds {
    let [[lower_x, lower_y, lower_z], [upper_x, upper_y, upper_z]] = [min.to_array(), max.to_array()];
    RTCBounds { lower_x, lower_y, lower_z, upper_x, upper_y, upper_z, ..Default::default() }
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

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::instances`].
unsafe extern "C" fn instance_bounds(args: *const RTCBoundsFunctionArguments) {
    // SAFETY: see above.
    unsafe {
        let placed = &*(*args).geometryUserPtr.cast::<Placed>();
        *(*args).bounds_o = rtc_bounds(placed.bounds[(*args).primID as usize]);
    }
}

impl Placed {
    /// The group of an instance, and the ray in its space unless that leaves the range of numbers.
    fn enter(&self, instance: u32, ray: &RTCRay) -> Option<(&Part, RTCRay)> {
        let instance = &self.instances[instance as usize];
        let ray = instance.ray(&our_ray(ray));
        super::is_valid(&ray).then(|| (&self.groups[instance.group as usize], rtc_ray(&ray)))
    }
}

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::instances`].
unsafe extern "C" fn instance_intersect(args: *const RTCIntersectFunctionNArguments) {
    // SAFETY: see above; for queries of one ray the packet is a plain RTCRayHit, and active.
    unsafe {
        let args = &*args;
        let query = &mut *args.rayhit.cast::<RTCRayHit>();
        let placed = &*args.geometryUserPtr.cast::<Placed>();
        let Some((group, ray)) = placed.enter(args.primID, &query.ray) else { return };
        let found = group.scene.nearest(ray);
        if found.hit.geomID != INVALID {
            // It may exceed the range by rounding.
            query.ray.tfar = found.ray.tfar.min(query.ray.tfar);
            query.hit = found.hit;
            query.hit.instID[0] = args.primID;
        }
    }
}

/// # Safety
/// Called by Embree with valid arguments, whose user pointer is that of [`Device::instances`].
unsafe extern "C" fn instance_occluded(args: *const RTCOccludedFunctionNArguments) {
    // SAFETY: see above; for queries of one ray the packet is a plain RTCRay, and active.
    unsafe {
        let args = &*args;
        let ray = &mut *args.ray.cast::<RTCRay>();
        let placed = &*args.geometryUserPtr.cast::<Placed>();
        if placed.enter(args.primID, ray).is_some_and(|(group, ray)| group.scene.any(ray)) {
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
