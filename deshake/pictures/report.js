"use strict";
// The slider is a range input: drag, touch and keys are the browser's own.
for (const slider of document.querySelectorAll(".slider")) {
  const input = slider.querySelector("input");
  const show = () => {
    slider.style.setProperty("--at", input.value + "%");
    input.setAttribute("aria-valuetext", Math.round(input.value) + " % before");
  };
  input.addEventListener("input", show);
  show();
}

// Both windows of a photo scroll together, and a mouse drags them.
for (const pair of document.querySelectorAll("details.around")) {
  const panes = [...pair.querySelectorAll(".pan")];
  const begin = () => {
    for (const pane of panes) {
      pane.scrollLeft = pane.dataset.x - (pane.clientWidth - pane.dataset.w) / 2;
      pane.scrollTop = pane.dataset.y - (pane.clientHeight - pane.dataset.h) / 2;
    }
  };
  pair.addEventListener("toggle", () => { if (pair.open) begin(); }, { once: true });
  pair.querySelector("button").addEventListener("click", begin);
  for (const pane of panes) {
    let from = null;
    pane.addEventListener("scroll", () => {
      for (const other of panes) {
        if (other.scrollLeft !== pane.scrollLeft) other.scrollLeft = pane.scrollLeft;
        if (other.scrollTop !== pane.scrollTop) other.scrollTop = pane.scrollTop;
      }
    });
    pane.addEventListener("pointerdown", (event) => {
      if (event.pointerType !== "mouse" || event.button !== 0) return;
      from = [event.clientX + pane.scrollLeft, event.clientY + pane.scrollTop];
      pane.setPointerCapture(event.pointerId);
      pane.classList.add("held");
    });
    pane.addEventListener("pointermove", (event) => {
      if (from) pane.scrollTo(from[0] - event.clientX, from[1] - event.clientY);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      pane.addEventListener(end, () => { from = null; pane.classList.remove("held"); });
    }
  }
}

// Rows and photos are sorted and filtered together.
const table = document.querySelector("table");
if (table) {
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const photos = new Map(rows.map((row) => [row, document.getElementById(row.dataset.photo)]));
  const list = document.querySelector("main");
  const filters = [...document.querySelectorAll(".tools button")];
  const search = document.querySelector(".tools input");
  const status = document.getElementById("shown");
  let chosen = "";
  const filter = () => {
    const words = search.value.trim().toLowerCase();
    let count = 0;
    for (const row of rows) {
      const fits = (!chosen || row.className === chosen) && row.textContent.toLowerCase().includes(words);
      row.hidden = photos.get(row).hidden = !fits;
      count += fits;
    }
    status.textContent = count + " of " + rows.length + " shown";
  };
  for (const button of filters) {
    button.addEventListener("click", () => {
      chosen = button.value;
      for (const other of filters) other.setAttribute("aria-pressed", String(other === button));
      filter();
    });
  }
  search.addEventListener("input", filter);
  const names = new Intl.Collator(undefined, { numeric: true });
  table.tHead.addEventListener("click", (event) => {
    const head = event.target.closest("th");
    if (!head) return;
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const key = (row) => row.cells[head.cellIndex].dataset.key;
    const byNumber = head.dataset.kind === "number";
    const compare = (one, two) => byNumber ? key(one) - key(two) : names.compare(key(one), key(two));
    const sorted = [...rows].sort((one, two) => (down ? -1 : 1) * compare(one, two));
    body.append(...sorted);
    list.append(...sorted.map((row) => photos.get(row)));
  });
  filter();
}
