//! A page of text, tables and charts, as Markdown and as HTML.

use std::{fmt::Write as _, io};

use maud::{DOCTYPE, Markup, PreEscaped, html};
use rig_chart::{Chart, ChartError, HeatMap, STYLE};

use crate::{files::Folder, outcome::StudyError};

/// A page under construction.
#[derive(Debug, Default)]
pub(crate) struct Page {
    pub(crate) title: String,
    pub(crate) parts: Vec<Part>,
}

/// An element of a page.
#[derive(Debug)]
pub(crate) enum Part {
    /// A heading.
    Heading(String),
    /// A paragraph of plain text; words in backquotes become code.
    Text(String),
    /// A table.
    Table(Table),
    /// A chart in a file of this name.
    Chart(String, Drawing),
    /// A data table in a file of this name.
    Data(String, String),
}

/// A chart or a map.
#[derive(Debug)]
pub(crate) enum Drawing {
    Chart(Box<Chart>),
    Map(Box<HeatMap>),
}

impl From<Chart> for Drawing {
    fn from(chart: Chart) -> Self {
        Self::Chart(Box::new(chart))
    }
}

impl From<HeatMap> for Drawing {
    fn from(map: HeatMap) -> Self {
        Self::Map(Box::new(map))
    }
}

impl Drawing {
    fn title(&self) -> &str {
        match self {
            Self::Chart(chart) => &chart.title,
            Self::Map(map) => &map.title,
        }
    }

    fn file(&self) -> Result<String, ChartError> {
        match self {
            Self::Chart(chart) => chart.file(),
            Self::Map(map) => map.file(),
        }
    }

    fn svg(&self, id: &str) -> Result<String, ChartError> {
        match self {
            Self::Chart(chart) => chart.svg(id),
            Self::Map(map) => map.svg(id),
        }
    }
}

/// Columns and rows of plain text.
#[derive(Debug)]
pub(crate) struct Table {
    pub(crate) columns: Vec<String>,
    pub(crate) rows: Vec<Vec<String>>,
}

impl Table {
    pub(crate) fn new(columns: &[&str]) -> Self {
        Self { columns: columns.iter().map(|&name| name.to_owned()).collect(), rows: Vec::new() }
    }

    pub(crate) fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }
}

impl Page {
    pub(crate) fn heading(&mut self, text: &str) {
        self.parts.push(Part::Heading(text.to_owned()));
    }

    pub(crate) fn text(&mut self, text: impl Into<String>) {
        self.parts.push(Part::Text(text.into()));
    }

    pub(crate) fn table(&mut self, table: Table) {
        self.parts.push(Part::Table(table));
    }

    pub(crate) fn chart(&mut self, file: &str, drawing: impl Into<Drawing>) {
        self.parts.push(Part::Chart(file.to_owned(), drawing.into()));
    }

    pub(crate) fn data(&mut self, file: &str, csv: impl Into<String>) {
        self.parts.push(Part::Data(file.to_owned(), csv.into()));
    }

    /// Writes `NAME.md` and `NAME.html`, and charts and data into the folder `NAME`; prints the path of
    /// the first.
    pub(crate) fn write(
        &self,
        folder: &Folder,
        name: &str,
        out: &mut impl io::Write,
    ) -> Result<(), StudyError> {
        let charts = Folder::at(&folder.path(name))?;
        for part in &self.parts {
            if let Part::Chart(file, chart) = part {
                charts.write(file, &chart.file()?)?;
            }
            if let Part::Data(file, text) = part {
                charts.write(file, text)?;
            }
        }
        let file = format!("{name}.md");
        folder.write(&file, &self.markdown(name))?;
        folder.write(&format!("{name}.html"), &self.html(name)?)?;
        Ok(writeln!(out, "{}", folder.path(&file).display())?)
    }

    /// The page as Markdown, with charts in the folder `name`.
    pub(crate) fn markdown(&self, name: &str) -> String {
        let mut text = format!("# {}\n", self.title);
        for part in &self.parts {
            text.push('\n');
            match part {
                Part::Heading(heading) => put(&mut text, format_args!("## {heading}\n")),
                Part::Text(paragraph) => put(&mut text, format_args!("{paragraph}\n")),
                Part::Table(table) => markdown_table(&mut text, table),
                Part::Chart(file, chart) => {
                    put(&mut text, format_args!("![{}]({name}/{file})\n", chart.title()));
                }
                Part::Data(file, _) => {
                    put(&mut text, format_args!("Data: [{file}]({name}/{file})\n"));
                }
            }
        }
        text
    }

    fn html(&self, name: &str) -> Result<String, ChartError> {
        let mut parts = Vec::new();
        for (index, part) in self.parts.iter().enumerate() {
            parts.push(match part {
                Part::Heading(heading) => html! { h2 { (heading) } },
                Part::Text(paragraph) => html! { p { (with_code(paragraph)) } },
                Part::Table(table) => html_table(table),
                Part::Chart(_, chart) => {
                    // The chart escapes its texts.
                    html! { figure { (PreEscaped(chart.svg(&format!("chart-{index}"))?)) } }
                }
                Part::Data(file, _) => {
                    html! { p { "Data: " a href={ (name) "/" (file) } { (file) } } }
                }
            });
        }
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    title { (self.title) }
                    style { (PreEscaped(PAGE_STYLE)) (PreEscaped(STYLE)) }
                }
                body {
                    h1 { (self.title) }
                    @for part in &parts { (part) }
                }
            }
        };
        Ok(page.into_string())
    }
}

const PAGE_STYLE: &str = "\
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #14181f; background: #ffffff;
  font: 16px/1.5 system-ui, -apple-system, \"Segoe UI\", Roboto, sans-serif; }
table { border-collapse: collapse; font-size: 0.875rem; margin: 1rem 0; display: block;
  overflow-x: auto; }
th, td { border-bottom: 1px solid #e4e7ec; padding: 0.3rem 0.7rem; text-align: left;
  vertical-align: top; font-variant-numeric: tabular-nums; }
th { border-bottom-color: #8a919c; }
figure { margin: 1rem 0; }
code { font-size: 0.9em; }
@media screen and (prefers-color-scheme: dark) {
  body { color: #eef1f5; background: #14181f; }
  th, td { border-color: #2c323b; }
}
";

/// Writing to a string does not fail.
fn put(text: &mut String, what: std::fmt::Arguments<'_>) {
    text.write_fmt(what).expect("a string accepts all text");
}

fn markdown_table(text: &mut String, table: &Table) {
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    text.push_str(&line(&table.columns));
    text.push_str(&line(&vec!["---".to_owned(); table.columns.len()]));
    for row in &table.rows {
        text.push_str(&line(row));
    }
}

fn html_table(table: &Table) -> Markup {
    html! {
        table {
            tr { @for column in &table.columns { th { (with_code(column)) } } }
            @for row in &table.rows {
                tr { @for value in row { td { (with_code(value)) } } }
            }
        }
    }
}

/// Text with its backquoted words as code and its `[name](target)` as links.
fn with_code(text: &str) -> Markup {
    html! {
        @for (index, piece) in text.split('`').enumerate() {
            @if index % 2 == 1 { code { (piece) } } @else { (with_links(piece)) }
        }
    }
}

fn with_links(text: &str) -> Markup {
    let link = || {
        let (before, rest) = text.split_once('[')?;
        let (name, rest) = rest.split_once("](")?;
        let (target, rest) = rest.split_once(')')?;
        // A bracket that is no link may stand before one that is.
        (!name.contains('[')).then_some((before, name, target, rest))
    };
    let Some((before, name, target, rest)) = link() else { return html! { (text) } };
    html! { (before) a href=(target) { (name) } (with_links(rest)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_the_same_in_markdown_and_html() {
        let mut page = Page { title: "A & B".to_owned(), parts: Vec::new() };
        page.heading("First");
        page.text("Run `cargo run` for a < b. See [x.md](x.md), [0, 1].");
        let mut table = Table::new(&["what", "value"]);
        table.row(["a|b", "1"]);
        page.table(table);
        assert_eq!(
            page.markdown("x"),
            "# A & B\n\n## First\n\nRun `cargo run` for a < b. See [x.md](x.md), [0, 1].\n\n\
             | what | value |\n| --- | --- |\n| a\\|b | 1 |\n"
        );
        let html = page.html("x").unwrap();
        for part in [
            "<title>A &amp; B</title>",
            "<h1>A &amp; B</h1>",
            "<p>Run <code>cargo run</code> for a &lt; b. See <a href=\"x.md\">x.md</a>, [0, 1].</p>",
            "<tr><th>what</th><th>value</th></tr><tr><td>a|b</td><td>1</td></tr>",
        ] {
            assert!(html.contains(part), "{part} is not in\n{html}");
        }
        assert!(!html.contains("http"), "the page asks another host for something");
    }
}
