//! A name for what a scene holds, so that results of different scenes are never mixed.

use super::Scene;
use crate::light::Light;
use crate::shape::{Mesh, Shape};
use crate::texture::Texture;
use bytemuck::Pod;
use std::fmt::{self, Debug, Write};
use xxhash_rust::xxh3::Xxh3;

struct Hasher(Xxh3);

impl Write for Hasher {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

impl Hasher {
    /// What is long, by its bytes.
    fn array<T: Pod>(&mut self, values: &[T]) {
        self.0.update(&(values.len() as u64).to_le_bytes());
        self.0.update(bytemuck::cast_slice(values));
    }

    /// What is short, by its text: that names fields and variants, and tells all floats apart.
    fn text(&mut self, value: &dyn Debug) {
        // Our own writer never fails.
        let _ = writeln!(self, "{value:?}");
    }
}

impl Scene {
    /// 128 bits over everything that passes are rendered from, in hexadecimal. What files look like (names, comments,
    /// order of attributes) leaves no trace, and neither does the integrator that they ask for.
    pub fn fingerprint(&self) -> String {
        // Named one by one, so that a new field cannot be forgotten.
        let Scene {
            geometry,
            textures,
            materials,
            lights,
            camera,
            film,
            shape_material,
            bounds: _,
            targets: _,
            casters: _,
            facets: _,
            shape_light: _,
            shape_wanted: _,
            shape_holes: _,
            has_holes: _,
            intersector: _,
        } = self;
        let mut hasher = Hasher(Xxh3::new());
        for shape in &geometry.shapes {
            match shape {
                Shape::Mesh(Mesh { positions, normals, uvs, triangles, attributes }) => {
                    hasher.text(&"mesh");
                    hasher.array(positions);
                    hasher.array(normals);
                    hasher.array(uvs);
                    hasher.array(triangles);
                    for attribute in attributes {
                        hasher.text(&attribute.name);
                        hasher.array(&attribute.values);
                    }
                }
                quadric => hasher.text(quadric),
            }
        }
        for group in &geometry.groups {
            hasher.text(group);
        }
        for instance in &geometry.instances {
            hasher.text(&instance.group);
            hasher.array(&instance.to_world().to_cols_array());
        }
        hasher.array(shape_material);
        for texture in textures {
            match texture {
                Texture::Bitmap(bitmap) => {
                    let (image, settings) = bitmap.contents();
                    hasher.text(&(image.width, image.height, settings));
                    hasher.array(&image.pixels);
                }
                procedural => hasher.text(procedural),
            }
        }
        for light in lights.lights() {
            match light {
                Light::Envmap(map) => {
                    let (width, pixels, to_world) = map.contents();
                    hasher.text(&(width, to_world));
                    hasher.array(pixels);
                }
                light => hasher.text(light),
            }
        }
        hasher.text(materials);
        hasher.text(camera);
        hasher.text(film);
        format!("{:032x}", hasher.0.digest128())
    }
}
