"""Style sheet of the HTML report, light and dark."""

from __future__ import annotations

STYLE = """
:root { color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --ink: #1b2230; --muted: #667085; --line: #e3e6ec;
  --good: #12733d; --good-bg: #ddf3e4; --bad: #a8201a; --bad-bg: #fbe3e1;
  --idle: #55606f; --idle-bg: #e9ecf1; --warn: #8a5a00; --warn-bg: #fbeecb;
  --focus: #1f5fc4; --edge: #8a94a6; --stage: #eef1f5; --differs: #c2185b; --hidden-then: #1e66d0;
  --series-1: #2463c5; --series-2: #c2571a; --series-3: #2c8a57; --series-4: #8247b5; }
@media (prefers-color-scheme: dark) { :root {
  --page: #12151b; --card: #1b2029; --ink: #e8ebf0; --muted: #98a2b3; --line: #2d3441;
  --good: #7fdba3; --good-bg: #17392a; --bad: #ff9b94; --bad-bg: #48201e;
  --idle: #b3bdcb; --idle-bg: #2d3441; --warn: #f3ce7a; --warn-bg: #43340f;
  --focus: #8ab6ff; --edge: #6b7688; --stage: #222936; --differs: #ff7aa8; --hidden-then: #82b4ff;
  --series-1: #7fb0ff; --series-2: #ffab73; --series-3: #7fdba3; --series-4: #cfa4f5; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif; }
main { max-width: 1080px; margin: 0 auto; padding: 32px 20px 64px; }
h1 { display: inline-block; margin: 0 14px 0 0; font-size: 28px; letter-spacing: -0.01em;
  overflow-wrap: anywhere; }
h2 { margin: 0 0 14px; font-size: 17px; }
p { margin: 6px 0 14px; }
.muted { color: var(--muted); }
section { background: var(--card); border: 1px solid var(--line); border-radius: 12px;
  padding: 20px 22px; margin-top: 18px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(130px, 1fr)); gap: 12px;
  margin-top: 18px; }
.tile { background: var(--card); border: 1px solid var(--line); border-radius: 12px;
  padding: 12px 16px; }
.tile b { display: block; font-size: 20px; font-weight: 600; white-space: nowrap; }
.tile span { color: var(--muted); font-size: 13px; }
.pill { display: inline-block; border-radius: 999px; padding: 1px 10px; font-size: 13px;
  font-weight: 600; white-space: nowrap; background: var(--idle-bg); color: var(--idle); }
.pill.pass { background: var(--good-bg); color: var(--good); }
.pill.fail { background: var(--bad-bg); color: var(--bad); }
.pill.incomplete { background: var(--warn-bg); color: var(--warn); }
header .pill { vertical-align: 6px; }
.verdict { display: grid; grid-template-columns: max-content 1fr; gap: 4px 16px; margin: 12px 0 0; }
.verdict dt { color: var(--muted); }
.verdict dd { margin: 0; overflow-wrap: anywhere; }
.verdict dd:first-of-type { font-size: 19px; font-weight: 600; line-height: 1.35; }
.verdict dt:first-of-type { line-height: 27px; }
.first { display: grid; grid-template-columns: minmax(0, 1fr) 300px; gap: 16px; padding: 14px;
  grid-template-areas: "stage beside" "stage controls"; grid-template-rows: auto 1fr; }
.stage { grid-area: stage; position: relative; min-height: 560px; }
.controls { grid-area: controls; }
.beside { grid-area: beside; display: grid; grid-template-columns: 1fr 1fr; gap: 8px;
  align-content: start; }
.beside img { display: block; width: 100%; border-radius: 8px; border: 1px solid var(--line);
  background: #ffffff; }
#view { position: absolute; inset: 0; width: 100%; height: 100%; border-radius: 8px;
  background: var(--stage); touch-action: pan-y; cursor: grab; }
.corner { position: absolute; top: 8px; right: 8px; display: grid; gap: 4px; }
.corner button { width: 36px; padding: 0; }
.no3d { display: none; padding: 40px 20px; }
.flat .no3d { display: block; }
.flat #view, .flat .needs3d { display: none; }
.flat .stage, html:not(.js) .stage { min-height: 0; }
html:not(.js):not(.flat) .needs3d, html:not(.js):not(.flat) #view { display: none; }
button { font: inherit; font-size: 14px; min-height: 36px; padding: 4px 12px; border-radius: 8px;
  border: 1px solid var(--edge); background: var(--card); color: var(--ink); cursor: pointer; }
button:hover { background: var(--idle-bg); }
button[aria-pressed="true"] { background: var(--focus); border-color: var(--focus);
  color: var(--card); }
figcaption button { font-size: 12px; min-height: 28px; padding: 2px 8px; }
:focus-visible { outline: 3px solid var(--focus); outline-offset: 2px; }
.row { display: flex; gap: 8px; margin-bottom: 12px; }
.joint { display: grid; grid-template-columns: 1fr max-content; margin-bottom: 8px; }
.joint output { font-variant-numeric: tabular-nums; font-weight: 600; }
.joint input { grid-column: 1 / 3; width: 100%; height: 28px; margin: 0;
  accent-color: var(--focus); }
.marks { grid-column: 1 / 3; position: relative; height: 14px; margin: 0 8px; font-size: 11px;
  color: var(--muted); }
.strip { grid-column: 1 / 3; position: relative; height: 5px; margin: 0 8px; border-radius: 3px;
  background: var(--good-bg); overflow: hidden; }
.strip i { position: absolute; top: 0; bottom: 0; }
.strip .bad { background: var(--bad); }
.strip .some { background: var(--series-2); }
.marks i { position: absolute; transform: translateX(-50%); font-style: normal; }
fieldset { border: 0; margin: 0 0 10px; padding: 0; }
legend { padding: 0; color: var(--muted); font-size: 13px; }
fieldset label { display: inline-block; margin-right: 12px; min-height: 26px; }
.small { font-size: 12px; margin: 2px 0 0; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; font-size: 13px; color: var(--muted); }
th, td { padding: 7px 14px 7px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
tr:last-child td { border-bottom: 0; }
.pictures { display: grid; gap: 18px;
  grid-template-columns: repeat(auto-fit, minmax(min(300px, 100%), 1fr)); }
figure { margin: 0; }
.wipe { position: relative; display: grid; grid-template-columns: 1fr 1fr; gap: 2px;
  border: 1px solid var(--line); border-radius: 8px; overflow: hidden; background: #ffffff; }
.wipe img { display: block; width: 100%; background: #ffffff; }
.wipe input { display: none; }
.js .wipe { display: block; }
.js .wipe .over { position: absolute; inset: 0; clip-path: inset(0 0 0 var(--at)); }
.wipe .mesh, section:has([name="wiped"][value="mesh"]:checked) .wipe:has(.mesh) .splats {
  display: none; }
section:has([name="wiped"][value="mesh"]:checked) .wipe .mesh { display: block; }
.js .wipe::after { content: ""; position: absolute; top: 0; bottom: 0; left: var(--at); width: 2px;
  background: var(--focus); pointer-events: none; }
.js .wipe::before { content: "↔"; position: absolute; z-index: 1; top: 50%; left: var(--at);
  width: 30px; height: 30px; line-height: 28px; text-align: center; border-radius: 50%;
  transform: translate(-50%, -50%); background: var(--focus); color: var(--card);
  pointer-events: none; }
.js .wipe input { display: block; position: absolute; inset: 0; width: 100%; height: 100%;
  margin: 0; opacity: 0; cursor: ew-resize; touch-action: pan-y; }
.wipe:focus-within { outline: 3px solid var(--focus); outline-offset: 2px; }
.marked { display: block; width: 100%; border-radius: 8px; border: 1px solid var(--line); }
.differs { color: var(--differs); }
.hidden-then { color: var(--hidden-then); }
figcaption { color: var(--muted); font-size: 13px; margin-top: 5px; }
svg { display: block; width: 100%; max-width: 820px; height: auto; }
.grid { stroke: var(--line); stroke-width: 1; }
.tick { fill: var(--muted); font-size: 11px; }
.series { font-size: 12px; font-weight: 600; }
.bars { display: grid; grid-template-columns: max-content 1fr max-content; gap: 6px 14px;
  align-items: center; }
.bar-track { background: var(--idle-bg); border-radius: 4px; }
.bar { background: var(--series-1); border-radius: 4px; height: 12px; min-width: 2px; }
.bar-value { color: var(--muted); font-variant-numeric: tabular-nums; text-align: right; }
ul { margin: 0; padding-left: 20px; }
summary { cursor: pointer; color: var(--muted); }
@media (max-width: 900px) {
  .first { grid-template-columns: minmax(0, 1fr); grid-template-rows: auto;
    grid-template-areas: "stage" "controls" "beside"; }
  .stage { min-height: 62vh; } }
@media (max-width: 600px) {
  main { padding: 16px 10px 48px; }
  section { padding: 14px 12px; }
  .first { padding: 8px; }
  .verdict { grid-template-columns: 1fr; gap: 0; }
  .verdict dd { margin-bottom: 8px; }
  .pictures { grid-template-columns: 1fr; }
  .stage { min-height: 52vh; }
  h1 { font-size: 23px; } }
@media print { section { break-inside: avoid; } .needs3d, .stage { display: none; } }
"""
