//! The page that shows a bench: one HTML file without scripts, with plots and pictures beside it.

use super::baseline::{Change, Verdict};
use super::pictures::{self, FULL_ERROR};
use super::report::Report;
use super::results::{Clock, Curve, Method, Spread, slug, targets};
use maud::{DOCTYPE, Markup, html};

const STYLE: &str = "
body { font: 15px/1.45 system-ui, sans-serif; color: #1a1a1a; background: #fff; max-width: 1180px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.6em } h2 { margin-top: 2.2em; border-top: 1px solid #ccc; padding-top: .8em }
table { border-collapse: collapse; margin: 1em 0; font-variant-numeric: tabular-nums }
th, td { padding: .25em .7em; text-align: right; border-bottom: 1px solid #e4e4e4; white-space: nowrap }
th:first-child, td:first-child { text-align: left } th { font-weight: 600 }
small { color: #666 } code { font-size: .92em; overflow-wrap: anywhere }
.worse { color: #b00020; font-weight: 600 } .better { color: #00702c; font-weight: 600 }
.pictures { display: flex; flex-wrap: wrap; gap: 1.2em 1em }
figure { margin: 0 } figcaption { font-size: .9em; margin-bottom: .2em }
.pictures img { width: 192px; image-rendering: pixelated; margin-right: 2px; vertical-align: top }
.plot { max-width: 100%; height: auto }
";

/// The page.
pub(super) fn page(report: &Report, curves: &[Curve], changes: &[Change]) -> String {
    let info = &report.info;
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Caustica: run time against error" }
                style { (maud::PreEscaped(STYLE)) }
            }
            body {
                h1 { "Run time against error" }
                p {
                    "caustica " (info.version) ", " (info.date) ", " (info.threads) " threads of " (info.cpu)
                    ", " (info.os) "." br;
                    code { (info.command) }
                }
                p {
                    "Seconds run from the start of loading a scene to the picture. They are CPU seconds, the work of all "
                    "processors together, where both of what is compared have them, else wall time. relmse is the mean over pixels and "
                    "channels of (x − ref)² / (ref² + 0.01), less the reference's own error where it is known. "
                    @if info.repeats > 1 {
                        "Medians of " (info.repeats) " runs with different seeds, their extremes in brackets and as crosses in "
                        "the plots. "
                    }
                    "All figures: " a href="results.csv" { "results.csv" } ", " a href="run.json" { "run.json" } "."
                }
                @if !report.notes.is_empty() {
                    ul { @for note in &report.notes { li { (note) } } }
                }
                @if let Some(baseline) = &report.baseline { (changes_table(baseline, changes)) }
                ul { @for scene in &report.scenes { li { a href={"#" (slug(&scene.name))} { (scene.name) } } } }
                @for scene in &report.scenes {
                    @let curves: Vec<&Curve> = curves.iter().filter(|c| c.method.scene == scene.name).collect();
                    h2 id=(slug(&scene.name)) { (scene.name) }
                    p {
                        "Reference: " (scene.reference.origin)
                        @if scene.reference.relmse > 0.0 { ", whose own relmse is " (number(scene.reference.relmse)) }
                        "."
                    }
                    img.plot src={"plots/" (slug(&scene.name)) ".svg"} alt={"Error over time, " (scene.name)};
                    (table(&curves))
                    p {
                        small {
                            "Picture, HDR-FLIP (violet none, yellow all), and relative error (blue too dark, red too bright; full at "
                            (100.0 * FULL_ERROR) " %) of the first run at its end."
                        }
                    }
                    div.pictures {
                        figure {
                            figcaption { "reference" }
                            img src={"images/" (reference_name(&scene.name))} alt="reference";
                        }
                        @for curve in &curves {
                            @if report.pictured.contains(&curve.method.slug()) { (figure(&curve.method)) }
                        }
                    }
                }
            }
        }
    }
    .into_string()
}

/// The reference's file name in `images/`.
pub(super) fn reference_name(scene: &str) -> String {
    format!("{}-reference.png", slug(scene))
}

fn figure(method: &Method) -> Markup {
    html! {
        figure {
            figcaption { (method.label()) }
            @for name in pictures::names(&method.slug()) {
                img src={"images/" (name)} alt=(name);
            }
        }
    }
}

fn table(curves: &[&Curve]) -> Markup {
    let targets = targets(curves);
    let first = curves.first();
    html! {
        table {
            tr {
                th { "method" } th { "seconds" } th { "load" } th { "samples" } th { "relmse at the end" } th { "bias" } th { "FLIP" }
                @for &target in &targets { th { "s to " (number(target)) } }
            }
            @for curve in curves {
                @if let Some(last) = curve.last() {
                    // A row is compared with the first.
                    @let clock = first.map_or(Clock::Wall, |first| Clock::of(&[first, curve]));
                    tr {
                        td { (curve.method.label()) " " small { (curve.method.version) } }
                        td { (clock.name()) }
                        td { (format!("{:.2} s", last.load_seconds.median)) }
                        td { (last.passes.median) }
                        td { (spread(last.error)) }
                        td { (format!("{:+.2} %", 100.0 * last.bias.median)) }
                        td { (format!("{:.3}", last.flip.median)) }
                        @for &target in &targets {
                            td {
                                @match curve.time_to(target, clock) {
                                    None => { @if let Some(timed) = last.timed(clock) { "> " (seconds(timed.seconds.median)) } },
                                    Some(reached) => {
                                        @if reached.at_once { "≤ " }
                                        (seconds(reached.seconds))
                                        @if let Some(best) = first.and_then(|c| c.time_to(target, clock)) {
                                            " " small { "×" (format!("{:.2}", reached.seconds / best.seconds)) }
                                        }
                                    },
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

fn changes_table(baseline: &str, changes: &[Change]) -> Markup {
    html! {
        h2 { "Since " code { (baseline) } }
        p {
            "Now over then. Cost is relmse times seconds (CPU seconds where both runs have them) at the largest common budget: how much longer an equal error takes. It is "
            "the product of the error at equal samples and the time per sample. Worse or better is what differs by more than "
            "a tenth and by more than runs do among themselves."
        }
        table {
            tr { th { "scene, method" } th { "seconds" } th { "cost" } th { "error per sample" } th { "time per sample" } th { "" } }
            @for change in changes {
                tr class=(change.verdict.name()) {
                    td { (change.method.scene) ", " (change.method.label()) }
                    td { (change.clock.name()) }
                    @for factor in [change.cost, change.error_per_pass, change.seconds_per_pass] {
                        td { "×" (format!("{factor:.3}")) }
                    }
                    td { @if change.verdict != Verdict::Same { (change.verdict.name()) } }
                }
            }
        }
    }
}

fn spread(s: Spread) -> Markup {
    html! { (number(s.median)) " " small { "[" (number(s.min)) ", " (number(s.max)) "]" } }
}

fn number(x: f64) -> String {
    format!("{x:.1e}")
}

fn seconds(s: f64) -> String {
    if s < 10.0 { format!("{s:.2}") } else { format!("{s:.1}") }
}
