"""How the page looks: light and dark, on screen and on paper."""

from __future__ import annotations

__all__ = ["STYLE"]

# Figures keep a white card in the dark, since their inks are made for white
STYLE = """
:root { color-scheme: light dark; --ink: #1c1e21; --faint: #5f6368; --paper: #ffffff; --line: #dadce0; --stripe: #f6f7f9;
  --link: #0b57a4;
  --held: #0b6b4f; --missed: #a63a00; --open: #5f6368; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e6ea; --faint: #a3a9b1; --paper: #16181c; --line: #3a3f46; --stripe: #1e2126;
  --link: #8ab8ef;
  --held: #58c9a3; --missed: #ff9a66; --open: #a3a9b1; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1180px; margin: 0 auto; padding: 2.5rem 1.25rem 5rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .6rem; } h2 { font-size: 1.4rem; margin: 3rem 0 .6rem; padding-top: .8rem;
  border-top: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 0 0 .35rem; } p { margin: .5rem 0; max-width: 46rem; } a { color: var(--link); }
.summary { font-size: 1.1rem; } nav { color: var(--faint); margin-top: 1rem; }
.note, figcaption { color: var(--faint); font-size: .875rem; max-width: 52rem; }
figure { margin: 2rem 0; } figure img { display: block; max-width: 100%; height: auto; background: #ffffff;
  border: 1px solid var(--line); border-radius: 6px; padding: 8px; }
figure img.lines { width: 100%; }
figcaption { margin-top: .5rem; } .table, details { margin: 2rem 0; } summary { cursor: pointer; font-weight: 600; }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .8rem; font-variant-numeric: tabular-nums;
  margin-top: .4rem; }
th, td { padding: .32rem .55rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
thead th { color: var(--faint); font-weight: 600; vertical-align: bottom; white-space: normal; min-width: 5.2rem; }
  th:first-child { text-align: left; }
tbody th { font-weight: 600; white-space: normal; min-width: 12rem; position: sticky; left: 0; background: var(--paper); }
td small, th small { display: block; color: var(--faint); font-size: .92em; font-weight: 400; white-space: normal; }
td small { min-width: 8rem; } .words { white-space: normal; color: var(--faint); font-size: .94em; }
tbody tr:nth-child(even), tbody tr:nth-child(even) th { background: var(--stripe); }
.held { color: var(--held); font-weight: 600; } .missed { color: var(--missed); font-weight: 600; } .open { color: var(--open);
  white-space: normal; }
dl { display: grid; grid-template-columns: minmax(8rem, 13rem) 1fr; gap: .35rem 1.2rem; } dt { font-weight: 600; } dd { margin: 0;
  max-width: 46rem; overflow-wrap: anywhere; }
@media (max-width: 640px) { dl { grid-template-columns: 1fr; } dd { margin-bottom: .6rem; } }
@media print { :root { --ink: #000000; --faint: #444444; --paper: #ffffff; --line: #bbbbbb; --stripe: #ffffff; }
  main { max-width: none; padding: 0; }
  nav { display: none; } body { font-size: 10pt; } table { font-size: 6.8pt; } th, td { padding: .15rem .3rem; white-space: normal; }
  thead th, tbody th { min-width: 0; }
  figure, tr { break-inside: avoid; } tbody th { position: static; } td small { min-width: 0; }
  h2, h3 { break-after: avoid; } .wide { overflow: visible; } }
@page { margin: 14mm; }
"""
