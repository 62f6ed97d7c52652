/* Sorting and filtering of the list of check reports. */
(() => {
  "use strict";
  const table = document.querySelector(".index table"), body = table.tBodies[0];
  const rows = [...body.rows], search = document.querySelector(".filters input");
  const buttons = [...document.querySelectorAll(".filters button")];
  let verdict = "";

  function filter() {
    const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = (verdict && row.dataset.verdict !== verdict) || !words.every((word) => text.includes(word));
    }
  }

  for (const button of buttons) {
    button.addEventListener("click", () => {
      verdict = button.dataset.verdict;
      for (const other of buttons) other.setAttribute("aria-pressed", String(other === button));
      filter();
    });
  }
  search.addEventListener("input", filter);

  for (const head of table.querySelectorAll("th[data-column]")) {
    head.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending", column = Number(head.dataset.column);
      for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const key = (row) => row.cells[column].dataset.key;
      rows.sort((a, b) => (up ? 1 : -1) * key(a).localeCompare(key(b), "en", { numeric: true }));
      body.append(...rows);
    });
  }
})();
