"use strict";
// Tables are sorted within each group of rows by a click on a head.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.firstElementChild.childNodes);
    head.firstElementChild.replaceWith(button);
    button.addEventListener("click", () => {
      const rising = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
      for (const body of table.tBodies) sortRows(body, column, rising);
    });
  });
}
function sortRows(body, column, rising) {
  const value = (row) => {
    const cell = row.cells[column], shown = cell.firstChild ? cell.firstChild.textContent : "";
    const number = cell.dataset.sort ?? (/^[-+]?\d+(\.\d+)?( %)?$/.test(shown) ? shown : undefined);
    if (number === undefined) return cell.textContent || null;
    return number === "" ? null : parseFloat(number.replace("inf", "Infinity"));
  };
  const compared = (a, b) => typeof a === "number" && typeof b === "number" ? a - b
    : String(a).localeCompare(String(b), "en", { numeric: true });
  const rows = [...body.rows].filter((row) => row.className !== "head").map((row) => [value(row), row]);
  rows.sort(([a], [b]) => a === null || b === null ? (a === null) - (b === null) : (rising ? 1 : -1) * compared(a, b));
  body.append(...rows.map(([, row]) => row));
}
addEventListener("beforeprint", () => document.querySelectorAll("details:not(.long)").forEach((one) => { one.open = true; }));
// A link into something that is folded opens it.
function unfold() {
  const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  for (let one = target; one; one = one.parentElement) if (one.tagName === "DETAILS") one.open = true;
  if (target) target.scrollIntoView();
}
addEventListener("hashchange", unfold);
unfold();
// The filters: rows and figures of estimators and scenarios that are not chosen are hidden.
const form = document.getElementById("filters");
if (form) {
  const boxes = (what) => [...form.querySelectorAll(`input[name="${what}"]`)];
  const chosen = (what) => new Set(boxes(what).filter((box) => box.checked).map((box) => box.value));
  const apply = () => {
    const shown = { estimator: chosen("estimator"), scenario: chosen("scenario") };
    for (const what of ["estimator", "scenario"]) {
      for (const one of document.querySelectorAll(`main [data-${what}]`))
        one.classList.toggle("off", !shown[what].has(one.dataset[what]));
    }
    const said = ["estimator", "scenario"].map((what) => {
      const every = boxes(what).length;
      if (every === 1) return `the only ${what}`;
      return shown[what].size === every ? `all ${every} ${what}s` : `${shown[what].size} of ${every} ${what}s`;
    });
    document.getElementById("filtered").textContent = said.join(", ");
  };
  form.addEventListener("change", apply);
  form.addEventListener("click", (event) => {
    const { all, none } = event.target.dataset;
    if (!all && !none) return;
    boxes(all || none).forEach((box) => { box.checked = Boolean(all); });
    apply();
  });
  form.hidden = false;
  apply();
}
for (const button of document.querySelectorAll("button.copy")) {
  button.hidden = false;
  button.addEventListener("click", async () => {
    const text = document.getElementById(button.dataset.copy);
    getSelection().selectAllChildren(text);
    try { await navigator.clipboard.writeText(text.textContent); button.textContent = "Copied"; } catch { document.execCommand("copy"); }
  });
}
