"""Style sheet of the HTML report, light and dark."""

from __future__ import annotations

STYLE = """
:root { color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --ink: #1b2230; --muted: #667085; --line: #e3e6ec;
  --good: #12733d; --good-bg: #ddf3e4; --bad: #a8201a; --bad-bg: #fbe3e1;
  --idle: #55606f; --idle-bg: #e9ecf1; --warn: #8a5a00; --warn-bg: #fbeecb;
  --series-1: #2463c5; --series-2: #c2571a; --series-3: #2c8a57; --series-4: #8247b5; }
@media (prefers-color-scheme: dark) { :root {
  --page: #12151b; --card: #1b2029; --ink: #e8ebf0; --muted: #98a2b3; --line: #2d3441;
  --good: #7fdba3; --good-bg: #17392a; --bad: #ff9b94; --bad-bg: #48201e;
  --idle: #b3bdcb; --idle-bg: #2d3441; --warn: #f3ce7a; --warn-bg: #43340f;
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
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(130px, 1fr)); gap: 12px; }
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
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; font-size: 13px; color: var(--muted); }
th, td { padding: 7px 14px 7px 0; border-bottom: 1px solid var(--line); vertical-align: top; }
tr:last-child td { border-bottom: 0; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(380px, 1fr)); gap: 18px; }
figure { margin: 0; }
.pair { display: grid; grid-template-columns: 1fr 1fr; gap: 2px; background: var(--line);
  border: 1px solid var(--line); border-radius: 8px; overflow: hidden; }
.pair img { display: block; width: 100%; background: #ffffff; }
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
@media print { section { break-inside: avoid; } }
"""
