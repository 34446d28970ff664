// Where the file of versions cannot be read, as from a folder without a server, the switcher shows this version.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll(".version-switcher__button").forEach((button) => {
    button.firstChild.textContent = `${DOCUMENTATION_OPTIONS.VERSION} `;
  });
});
