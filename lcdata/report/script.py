"""The page's script: without it everything is there to be read, tables just do not sort."""

from __future__ import annotations

SCRIPT = """
"use strict";
const keyOf = (row, column) => {
  const cell = row.cells[column];
  if (!("sort" in cell.dataset)) return cell.textContent.trim().toLowerCase();
  return cell.dataset.sort === "" ? null : Number(cell.dataset.sort);
};
const compare = (a, b) =>
  typeof a === "number" ? a - b || 0 : a.localeCompare(b, "en", { numeric: true });
const sort = (table, heads, column, direction) => {
  for (const body of table.tBodies) {
    const rows = [...body.rows].filter((row) => !row.classList.contains("scenario"));
    const keyed = rows.map((row) => [keyOf(row, column), row]);
    keyed.sort(([a], [b]) => {
      if (a === null || b === null) return (a === null) - (b === null);
      return a === b ? 0 : direction * compare(a, b);
    });
    body.append(...keyed.map(([, row]) => row));
  }
  heads.forEach((head, at) => {
    const sorted = direction > 0 ? "ascending" : "descending";
    head.setAttribute("aria-sort", at === column ? sorted : "none");
  });
};
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    head.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const again = head.getAttribute("aria-sort") === "ascending";
      sort(table, heads, column, again ? -1 : 1);
    });
  });
}
const copy = async (source) => {
  try {
    await navigator.clipboard.writeText(source.textContent);
    return true;
  } catch {
    const range = document.createRange();
    range.selectNodeContents(source);
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    return document.execCommand("copy");
  }
};
for (const block of document.querySelectorAll(".copied")) {
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = "Copy";
  button.addEventListener("click", async () => {
    button.textContent = (await copy(block.querySelector("code, pre"))) ? "Copied" : "Selected";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  });
  block.append(button);
}
"""
