//! The HTML around figures: style, library, script and data in one file.

use serde_json::Value;

const LIBRARY: &str = include_str!("../page/uPlot.iife.min.js");
const LIBRARY_STYLE: &str = include_str!("../page/uPlot.min.css");
const STYLE: &str = include_str!("../page/report.css");
const PARTS: &str = include_str!("../page/parts.js");
const FLIGHT: &str = include_str!("../page/flight.js");
const CAMPAIGN: &str = include_str!("../page/campaign.js");

/// The page of a flight.
pub(crate) fn flight(title: &str, data: &Value) -> String {
    page(title, data, &[LIBRARY, PARTS, FLIGHT])
}

/// The page of a campaign.
pub(crate) fn campaign(title: &str, data: &Value) -> String {
    page(title, data, &[PARTS, CAMPAIGN])
}

fn page(title: &str, data: &Value, scripts: &[&str]) -> String {
    let title = title
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;");
    // Nothing in it ends the element that it stands in.
    let data = data.to_string().replace('<', "\\u003c");
    let scripts: String = scripts
        .iter()
        .map(|script| format!("<script>\n{script}</script>\n"))
        .collect();
    format!(
        r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:">
<title>{title}</title>
<style>
{LIBRARY_STYLE}
{STYLE}</style>
</head>
<body>
<noscript>The figures stand in this file as JSON; a browser that runs its script draws them.</noscript>
<main></main>
<script type="application/json" id="data">{data}</script>
{scripts}</body>
</html>
"#
    )
}
