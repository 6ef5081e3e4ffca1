_facetctl() {
    local cur="${COMP_WORDS[COMP_CWORD]}" prev="${COMP_WORDS[COMP_CWORD-1]}" words=
    COMPREPLY=()
    case "$prev" in
        @@files@@) COMPREPLY=($(compgen -f -- "$cur")); return ;;
    esac
    if [ "$COMP_CWORD" = 1 ]; then
        words="@@first@@"
    else
        case "${COMP_WORDS[1]}" in
@@cases@@
        esac
    fi
    case "$cur" in
        -*) ;;
        *) case " @@asked@@ " in
            *" ${COMP_WORDS[1]} "*) [ "$COMP_CWORD" -gt 1 ] &&
                words="$words $(facetctl completion of "${COMP_WORDS[@]:1:$COMP_CWORD}" 2>/dev/null)" ;;
           esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
    case "${COMP_WORDS[1]}" in
        @@takers@@) [ "$COMP_CWORD" -gt 1 ] && COMPREPLY+=($(compgen -f -- "$cur")) ;;
    esac
}
complete -o filenames -F _facetctl facetctl
