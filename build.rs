//! With the feature `embree`: finds the system's Embree 4 or 3 through bindgen, writes its bindings to
//! `$OUT_DIR/embree.rs`, links it, and sets `cfg(embree = "4")` or `cfg(embree = "3")`.

fn main() {
    println!("cargo::rustc-check-cfg=cfg(embree, values(\"3\", \"4\"))");
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=wrapper/embree.h");
    #[cfg(feature = "embree")]
    if let Err(reason) = embree() {
        println!(
            "cargo::error=cannot use Embree ({reason}); run `apt-get install -y libembree-dev libclang-dev`, or build \
             without it: `cargo build --no-default-features --features bvh`"
        );
    }
}

#[cfg(feature = "embree")]
fn embree() -> Result<(), String> {
    let builder = bindgen::Builder::default()
        .header("wrapper/embree.h")
        .allowlist_function(
            "rtc(New|Release)(Device|Scene|Geometry)|rtcGetDeviceError|rtcSetScene(Flags|BuildQuality)\
             |rtcCommit(Scene|Geometry)|rtcAttachGeometryByID|rtcSetNewGeometryBuffer\
             |rtcSetGeometry(UserPrimitiveCount|UserData|BoundsFunction|IntersectFunction|OccludedFunction\
             |IntersectFilterFunction|OccludedFilterFunction)\
             |rtcIntersect1|rtcOccluded1",
        )
        .allowlist_type("RTCRayHit|RTCRayQueryContext|RTCIntersectContext")
        .allowlist_var("RTC_VERSION_MAJOR|RTC_MAX_INSTANCE_LEVEL_COUNT")
        .default_enum_style(bindgen::EnumVariation::Consts)
        .prepend_enum_name(false)
        .derive_default(true)
        .generate_comments(false)
        .parse_callbacks(Box::new(bindgen::CargoCallbacks::new()));
    use std::panic::AssertUnwindSafe;
    // Without libclang bindgen panics; its message belongs into ours.
    std::panic::set_hook(Box::new(|_| ()));
    let generated = std::panic::catch_unwind(AssertUnwindSafe(|| builder.generate()));
    let _ = std::panic::take_hook();
    let bindings = match generated {
        Ok(Ok(bindings)) => bindings,
        Ok(Err(e)) => return Err(one_line(&e.to_string())),
        Err(_) => return Err("libclang is missing".into()),
    };
    let text = bindings.to_string();
    // Without spaces: they depend on whether rustfmt is installed.
    let dense: String = text.split_whitespace().collect();
    let version = ["4", "3"].into_iter().find(|v| dense.contains(&format!("RTC_VERSION_MAJOR:u32={v};")));
    let version = version.ok_or("its version is neither 4 nor 3")?;
    let out = std::env::var("OUT_DIR").map_err(|e| e.to_string())? + "/embree.rs";
    std::fs::write(&out, text).map_err(|e| format!("{out}: {e}"))?;
    println!("cargo::rustc-cfg=embree=\"{version}\"");
    println!("cargo::rustc-link-lib=embree{version}");
    Ok(())
}

#[cfg(feature = "embree")]
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}
