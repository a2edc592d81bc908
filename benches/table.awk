# Makes a Markdown table of what `cargo bench` printed: a line for each method, a column for each scene, device and kind
# of rays, and in it millions of rays (or triangles) a second.

BEGIN { millions["elem/s"] = 1e-6; millions["Kelem/s"] = 1e-3; millions["Melem/s"] = 1; millions["Gelem/s"] = 1e3 }

# The name stands alone or, if it is short, before the time.
/^[^ ]+\/[^ ]+( +time:|$)/ { name = $1 }

# thrpt:  [low unit estimate unit high unit]; lines of changes have no units.
/thrpt:.*elem\/s/ {
    method = name; sub(/.*\//, "", method)
    column = substr(name, 1, length(name) - length(method) - 1)
    if (!(method in is_method)) { is_method[method]; methods[++lines] = method }
    if (!(column in is_column)) { is_column[column]; columns[++width] = column }
    unsure = $6 * millions[substr($7, 1, length($7) - 1)] > 1.1 * substr($2, 2) * millions[$3] ? "~" : ""
    rate[method, column] = unsure sprintf("%.3g", $4 * millions[$5])
}

END {
    head = "| |"; rule = "|---|"
    for (i = 1; i <= width; i++) {
        title = columns[i]; gsub("/", " ", title)
        head = head " " title " |"; rule = rule "--:|"
    }
    print head; print rule
    for (j = 1; j <= lines; j++) {
        line = "| " methods[j] " |"
        for (i = 1; i <= width; i++) line = line " " rate[methods[j], columns[i]] " |"
        print line
    }
}
