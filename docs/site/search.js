/* Search in pages that are opened as files. A browser lets these load scripts, but start no Worker and
   fetch no JSON, which mkdocs' own search does. From a server that one works, and this does nothing. */
document.addEventListener("DOMContentLoaded", function () {
    const input = document.getElementById("mkdocs-search-query");
    if (location.protocol !== "file:" || !document.getElementById("mkdocs-search-results")) return;

    function load(name) {
        return new Promise(function (done) {
            const script = document.createElement("script");
            script.src = base_url + "/search/" + name;
            script.onload = done;
            document.head.append(script);
        });
    }

    function start() {
        const index = lunr(function () {
            this.ref("location");
            this.field("title");
            this.field("text");
            searchIndex.docs.forEach(this.add, this);
        });
        const pages = new Map(searchIndex.docs.map((page) => [page.location, page]));

        function show() {
            const found = input.value ? index.search(input.value) : [];
            displayResults(found.map(function (hit) { /* displayResults: of mkdocs' search/main.js */
                const page = pages.get(hit.ref);
                return { ...page, summary: page.text.substring(0, 200) };
            }));
        }

        input.value = new URLSearchParams(location.search).get("q") || "";
        input.addEventListener("input", show);
        show();
    }

    Promise.all([load("lunr.js"), load("search_index.js")]).then(start);
});
