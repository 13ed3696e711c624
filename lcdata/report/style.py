"""Style sheet of the report page: one column, hairlines, light and dark."""

from __future__ import annotations

STYLE = """
:root {
  color-scheme: light dark;
  --paper: #fcfbf9; --ink: #202326; --muted: #6c7178; --line: #e3dfd8; --wash: #f4f1ec;
  --good: #2d7d5a; --bad: #b23b45;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #17191c; --ink: #e6e4df; --muted: #979ca4; --line: #2d3035; --wash: #1f2226;
    --good: #6cc197; --bad: #e57f88;
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
.cards { display: flex; flex-wrap: wrap; gap: 16px; margin: 24px 0 8px; }
.card { flex: 1 1 240px; padding: 18px 22px; border: 1px solid var(--line); border-radius: 10px; }
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
tr.scenario td { padding-top: 20px; font-weight: 620; border-bottom: 1px solid var(--line);
  text-align: left; }
tr.scenario td span { font-weight: 400; color: var(--muted); margin-left: .8em; }
td small { color: var(--muted); font-size: 12.5px; }
td .best { font-weight: 680; }
abbr { text-decoration: none; cursor: help; color: var(--muted); }
.bad, td small.bad { color: var(--bad); } .good { color: var(--good); }
ul { padding-left: 1.2em; margin: 8px 0; } li { margin: 3px 0; }
.plot img { width: 100%; height: auto; display: block; margin-top: 12px; }
figure { margin: 0; }
.row { display: grid; grid-template-columns: repeat(3, 1fr); gap: 10px; margin: 4px 0 26px; }
.row img { width: 100%; height: auto; display: block; border-radius: 5px; background: var(--wash); }
.row label { cursor: zoom-in; }
.row input { position: absolute; opacity: 0; pointer-events: none; }
.row input:focus-visible + img { outline: 2px solid var(--muted); outline-offset: 2px; }
.row input:checked + img { position: fixed; inset: 0; margin: auto; width: 96vw; height: 96vh;
  object-fit: contain; z-index: 2; cursor: zoom-out; background: var(--paper);
  box-shadow: 0 0 0 100vmax var(--paper); }
.row figcaption { font-size: 13px; margin-top: 4px; }
.row .none { border: 1px dashed var(--line); border-radius: 5px; display: grid;
  place-items: center; min-height: 120px; color: var(--muted); font-size: 14px; }
.trial { font-size: 14.5px; margin: 18px 0 8px; max-width: none; }
.trial b { text-transform: capitalize; font-weight: 620; }
.scale { display: inline-block; width: 84px; height: 8px; border-radius: 4px; margin: 0 6px;
  background: linear-gradient(90deg, #a01602, #f56918, #d5e234, #45f884, #26bce1, #4669df,
  #30123b); }
code { font: 13.5px/1.5 ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; }
footer { margin-top: 64px; padding-top: 16px; border-top: 1px solid var(--line);
  font-size: 13.5px; color: var(--muted); }
@media (max-width: 720px) { main { padding: 28px 16px; } .row { grid-template-columns: 1fr; } }
@media print { body { background: #fff; } .card, tr, figure { break-inside: avoid; } }
"""
