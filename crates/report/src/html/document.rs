//! The frame of a page: its head, its styles and its body.

use maud::{DOCTYPE, Markup, PreEscaped, html};

/// A page that asks no other host for anything. With `reload_s`, a browser loads it again after this time, s.
pub fn document(title: &Markup, styles: &[&str], reload_s: Option<u32>, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta http-equiv="Content-Security-Policy"
                    content="default-src 'none'; style-src 'unsafe-inline'";
                @if let Some(seconds) = reload_s { meta http-equiv="refresh" content=(seconds); }
                title { (title) }
                style { @for style in styles { (PreEscaped(style)) } }
            }
            body { (body) }
        }
    }
}
