// On narrow screens, a table that does not fit becomes a list for each row, labelled by its heads.
function labelCells() {
  for (const table of document.querySelectorAll(".md-typeset table:not([class])")) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent.trim());
    for (const row of table.querySelectorAll("tbody tr"))
      [...row.children].forEach((cell, column) => { cell.dataset.label = heads[column] ?? ""; });
  }
  stackTables();
}

function stackTables() {
  const width = document.querySelector(".md-content__inner").clientWidth;
  for (const table of document.querySelectorAll(".md-typeset table:not([class])")) {
    delete table.dataset.stacked;
    if (window.innerWidth < 720 && table.offsetWidth > width) table.dataset.stacked = "";
  }
}

document.addEventListener("DOMContentLoaded", labelCells);
window.addEventListener("load", stackTables);
window.addEventListener("resize", stackTables);
