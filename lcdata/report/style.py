"""Style sheet of the report page: one column, hairlines, light and dark."""

from __future__ import annotations

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fcfbf9; --ink: #202326; --muted: #6c7178; --line: #e3dfd8; --wash: #f4f1ec;
  --good: #2d7d5a; --bad: #b23b45; --focus: #2f6db3;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #17191c; --ink: #e6e4df; --muted: #979ca4; --line: #2d3035; --wash: #1f2226;
    --good: #6cc197; --bad: #e57f88; --focus: #6fa8e6;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 ui-sans-serif, system-ui, -apple-system, "Segoe UI", "Helvetica Neue",
    Arial, sans-serif;
}
main { max-width: 1180px; margin: 0 auto; padding: 56px 32px 80px; }
h1 { font-size: 34px; line-height: 1.2; font-weight: 650; letter-spacing: -.015em;
  margin: 6px 0 14px; text-wrap: balance; }
h2 { font-size: 22px; font-weight: 620; letter-spacing: -.01em; margin: 64px 0 8px; }
h3 { font-size: 16px; font-weight: 620; margin: 40px 0 10px; }
p { max-width: 84ch; margin: 0 0 12px; }
em { font-style: normal; }
.muted, figcaption, .note { color: var(--muted); }
.note { font-size: 14px; max-width: 104ch; }
details { margin: 28px 0 0; }
summary { cursor: pointer; font-weight: 620; }
.kind { font-size: 13px; font-weight: 600; letter-spacing: .08em; text-transform: uppercase;
  color: var(--muted); }
.warning { border-left: 3px solid var(--bad); padding: 10px 18px; margin: 18px 0;
  background: var(--wash); }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(236px, 100%), 1fr));
  gap: 16px; margin: 24px 0 8px; }
.card { padding: 18px 22px; border: 1px solid var(--line); border-radius: 10px; }
.card b { display: block; font-size: 34px; font-weight: 620; letter-spacing: -.02em;
  line-height: 1.25; font-variant-numeric: tabular-nums; }
.card span { display: block; color: var(--muted); font-size: 14px; }
.card .name { color: var(--ink); font-weight: 620; font-size: 15px; }
.dot { display: inline-block; width: .62em; height: .62em; border-radius: 50%;
  margin-right: .5em; background: var(--c); }
@media (prefers-color-scheme: dark) { .dot { background: var(--d); } }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: 14.5px;
  font-variant-numeric: tabular-nums; margin: 18px 0 10px; }
th { text-align: right; font-weight: 560; color: var(--muted); font-size: 13px;
  padding: 6px 10px; vertical-align: bottom; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
td { text-align: right; padding: 7px 10px; white-space: nowrap; vertical-align: top; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
tr.scenario th { padding: 20px 10px 7px 0; font-weight: 620; font-size: 14.5px; color: var(--ink);
  text-align: left; }
tr.scenario th span { font-weight: 400; color: var(--muted); margin-left: .8em; }
tbody tr:not(.scenario):hover td { background: var(--wash); }
th button { font: inherit; color: inherit; background: none; border: 0; padding: 0; margin: 0;
  cursor: pointer; }
th button::after { content: "↕"; display: inline-block; width: 1.1em; text-align: right;
  opacity: .35; }
th[aria-sort="ascending"] button::after { content: "↑"; opacity: 1; }
th[aria-sort="descending"] button::after { content: "↓"; opacity: 1; }
th[aria-sort="ascending"], th[aria-sort="descending"] { color: var(--ink); }
th button:hover { color: var(--ink); }
:focus-visible { outline: 2px solid var(--focus); outline-offset: 2px; border-radius: 3px; }
.pairwise td:nth-child(2), .pairwise th:nth-child(2) { text-align: left; }
.worded td:nth-child(n+3), .worded th:nth-child(n+3) { text-align: left; white-space: normal; }
td small { color: var(--muted); font-size: 12.5px; }
td .best { font-weight: 680; }
abbr { text-decoration: none; cursor: help; color: var(--muted); }
.bad, td small.bad { color: var(--bad); } .good { color: var(--good); }
ul { padding-left: 1.2em; margin: 8px 0; } li { margin: 3px 0; }
.plot img { width: 100%; height: auto; display: block; margin-top: 12px; }
figure { margin: 0; }
.row { display: grid; gap: 10px; }
.under .row { grid-template-columns: repeat(3, 1fr); }
.beside { display: grid; grid-template-columns: minmax(0, 19rem) minmax(0, 1fr); gap: 24px; }
.beside .row { grid-template-columns: 1fr 1fr; align-content: start; }
.exhibit { padding: 16px 0; border-top: 1px solid var(--line); }
.exhibit .row { min-width: 0; }
.under .about { display: grid; grid-template-columns: minmax(0, 1fr) auto; gap: 2px 24px;
  margin-bottom: 8px; }
.under .about .copied { grid-area: 1 / 2 / 3 / 3; align-self: start; max-width: 30rem; }
.under .about .note { grid-column: 2; }
.about { font-size: 14px; min-width: 0; }
.about p { margin: 0 0 4px; }
.about .note { font-size: 12.5px; }
.about ul { list-style: none; padding: 0; margin: 0 0 4px; }
.about li { margin: 1px 0; }
.under .about li { display: inline; }
.under .about li + li::before { content: "·"; margin: 0 .5em; color: var(--muted); }
.row img { width: 100%; height: auto; display: block; border-radius: 5px; background: var(--wash); }
.row label { cursor: zoom-in; }
.row input { position: absolute; opacity: 0; pointer-events: none; }
.row input:focus-visible + img { outline: 2px solid var(--focus); outline-offset: 2px; }
.row input:checked + img { position: fixed; inset: 0; margin: auto; width: 96vw; height: 96vh;
  object-fit: contain; z-index: 2; cursor: zoom-out; background: var(--paper);
  box-shadow: 0 0 0 100vmax var(--paper); }
.row figcaption { font-size: 13px; margin-top: 4px; }
.row .none { border: 1px dashed var(--line); border-radius: 5px; display: grid;
  place-items: center; min-height: 120px; color: var(--muted); font-size: 14px; }
.trial b { font-weight: 620; }
.copied { position: relative; background: var(--wash); border-radius: 6px; padding: 7px 10px;
  margin: 6px 0; padding-right: 62px; }
.copied code { font-size: 12.5px; overflow-wrap: anywhere; display: block; }
.copied code span { display: inline-block; }
.copied pre { font: 12.5px/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace;
  overflow: auto; max-height: 320px; margin: 4px 0 0; }
.copied > button { position: absolute; top: 5px; right: 5px; font: inherit; font-size: 12px;
  line-height: 1; padding: 5px 7px; border-radius: 5px; border: 1px solid var(--line);
  background: var(--paper); color: var(--muted); cursor: pointer; }
.copied > button:hover { color: var(--ink); border-color: var(--muted); }
.notations { margin-top: 10px; font-size: 14px; }
.notations summary { font-weight: 400; color: var(--muted); }
h4 { font-size: 15px; font-weight: 620; margin: 0; }
.method { display: flex; flex-wrap: wrap; align-items: center; justify-content: space-between;
  gap: 4px 24px; margin: 34px 0 10px; }
.method .copied { margin: 0; }
a { color: inherit; text-underline-offset: 2px; text-decoration-color: var(--muted); }
.scale { display: inline-block; width: 84px; height: 8px; border-radius: 4px; margin: 0 6px;
  background: linear-gradient(90deg, #a01602, #f56918, #d5e234, #45f884, #26bce1, #4669df,
  #30123b); }
code { font: 13.5px/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; }
footer { margin-top: 64px; padding-top: 16px; border-top: 1px solid var(--line);
  font-size: 13.5px; color: var(--muted); }
@media (max-width: 720px) {
  main { padding: 28px 16px; }
  h1 { font-size: 27px; }
  .under .row, .beside, .beside .row, .under .about { grid-template-columns: minmax(0, 1fr); }
  .beside { gap: 10px; }
  .plot picture { display: block; overflow-x: auto; }
  .plot img { width: 760px; max-width: none; }
  .under .about .copied, .under .about .note { grid-area: auto; }
}
@media print {
  body { background: #fff; }
  .card, tr, figure, .exhibit { break-inside: avoid; }
  .copied > button, th button::after { display: none; }
}
"""
