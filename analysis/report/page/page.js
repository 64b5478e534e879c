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
    const cell = row.cells[column];
    const number = cell.dataset.sort;
    return number === undefined ? cell.textContent : number === "" ? null : Number(number.replace("inf", "Infinity"));
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
{
  const form = document.getElementById("filters");
  const boxes = (what) => [...form.querySelectorAll(`input[name="${what}"]`)];
  const chosen = (what) => new Set(boxes(what).filter((box) => box.checked).map((box) => box.value));
  const apply = () => {
    const shown = { estimator: chosen("estimator"), scenario: chosen("scenario") };
    for (const what of ["estimator", "scenario"]) {
      for (const one of document.querySelectorAll(`main [data-${what}]`))
        one.classList.toggle("off", !shown[what].has(one.dataset[what]));
    }
    for (const one of document.querySelectorAll("[data-estimators]"))
      one.classList.toggle("off", !JSON.parse(one.dataset.estimators).some((name) => shown.estimator.has(name)));
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
// A click on an RMSE draws its trials against those of another estimator of the same scenario.
{
  const packed = new Map(JSON.parse(document.getElementById("trials").textContent).map((one) => [one.scenario, one]));
  const dialog = document.getElementById("pairs");
  const [across, up, figure, said, file] = ["x", "y", "figure", "said", "file"].map((id) => document.getElementById(`pairs-${id}`));
  let scenario = "";
  const errors = (name) => {  // RMSE [m] by trial; null where the trial failed
    const one = packed.get(scenario);
    return one.rmse[one.estimators.indexOf(name)];
  };
  const element = (tag, attributes, text = "") => {
    const one = document.createElementNS("http:" + "//www.w3.org/2000/svg", tag);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    one.textContent = text;
    return one;
  };
  const ticks = (low, high) => {
    const found = [];
    for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++)
      for (const m of high / low < 30 ? [1, 1.5, 2, 3, 5, 7] : [1, 3]) found.push(m * 10 ** k);
    return found.filter((v) => v >= low && v <= high);
  };
  const draw = () => {
    const one = packed.get(scenario), a = errors(across.value), b = errors(up.value);
    const pairs = one.trials.map((trial, k) => [trial, a[k], b[k]]).filter(([, x, y]) => x !== null && y !== null);
    const values = pairs.flatMap(([, x, y]) => [x, y]);
    const low = Math.min(...values) / 1.1, high = Math.max(...values) * 1.1;
    const at = (v) => Math.log(v / low) / Math.log(high / low) * 330;
    figure.replaceChildren(element("rect", { class: "axis", x: 60, y: 10, width: 330, height: 330 }),
      element("line", { class: "equal", x1: 60, y1: 340, x2: 390, y2: 10 }));
    for (const v of values.length ? ticks(low, high) : []) {
      const label = String(Number(v.toPrecision(2)));
      figure.append(element("text", { x: 60 + at(v), y: 357, "text-anchor": "middle" }, label),
        element("text", { x: 54, y: 344 - at(v), "text-anchor": "end" }, label));
    }
    figure.append(element("text", { x: 225, y: 380, "text-anchor": "middle" }, `RMSE [m], ${across.selectedOptions[0].text}`),
      element("text", { x: 14, y: 175, "text-anchor": "middle", transform: "rotate(-90 14 175)" }, `RMSE [m], ${up.selectedOptions[0].text}`));
    for (const [trial, x, y] of pairs) {
      const mark = element("circle", { class: "trial", cx: 60 + at(x), cy: 340 - at(y), r: 4 });
      mark.append(element("title", {}, `trial ${trial}: ${x.toPrecision(4)} m, ${y.toPrecision(4)} m`));
      figure.append(mark);
    }
    const below = pairs.filter(([, x, y]) => y < x).length;
    const more = one.every > one.trials.length ? `, the first of ${one.every}` : "";
    said.textContent = `${up.selectedOptions[0].text} has the smaller error in ${below} of ${pairs.length} trials${more}: `
      + "those below the dotted line.";
  };
  const fill = (select, names, chosen) => select.replaceChildren(...names.map((name) => {
    const label = document.querySelector(`#filters input[value="${CSS.escape(name)}"]`).parentElement.textContent.trim();
    return new Option(label, name, false, name === chosen);
  }));
  document.addEventListener("click", (event) => {
    const link = event.target.closest("a.trials"), row = link && link.closest("tr");
    const where = row && row.closest("[data-scenario]");
    if (!where || !packed.has(where.dataset.scenario) || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    scenario = where.dataset.scenario;
    const names = packed.get(scenario).estimators, mine = row.dataset.estimator;
    const baseline = row.dataset.baseline;
    fill(across, names, baseline && baseline !== mine ? baseline : names.find((name) => name !== mine) || mine);
    fill(up, names, mine);
    document.getElementById("pairs-title").textContent = `Trial by trial: ${scenario}`;
    file.href = link.getAttribute("href");
    draw();
    dialog.showModal();
  });
  document.getElementById("pairs-close").addEventListener("click", () => dialog.close());
  across.addEventListener("change", draw);
  up.addEventListener("change", draw);
}
for (const button of document.querySelectorAll("button.copy")) {
  button.hidden = false;
  button.addEventListener("click", async () => {
    const text = document.getElementById(button.dataset.copy);
    getSelection().selectAllChildren(text);
    try { await navigator.clipboard.writeText(text.textContent); button.textContent = "Copied"; } catch { document.execCommand("copy"); }
  });
}
