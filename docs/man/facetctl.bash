_facetctl() {
    local cur="${COMP_WORDS[COMP_CWORD]}" prev="${COMP_WORDS[COMP_CWORD-1]}" words=
    COMPREPLY=()
    case "$prev" in
        --calibration|--config|--draw|--facets|--mesh|--model|--opencv|--out|--parts|--ros|--runs|--socket|--views) COMPREPLY=($(compgen -f -- "$cur")); return ;;
    esac
    if [ "$COMP_CWORD" = 1 ]; then
        words="--help --version abort accept arm auto bundle calibrate cameras clear commission completion confirm console dashboard demo disable doctor dry enable export fleet forget go gripper hand help here holding job jog look model note notices operator parts pause pick place positions recognise refuse reload replay resume review robot rollback runs scatter script show signal snap status step stop stream switch tail teach thesis train try untaught views where"
    else
        case "${COMP_WORDS[1]}" in
            arm) words="-h --help identify --baud --out --lengths --pendant replay" ;;
            calibrate) words="-h --help board --paper a2 a3 a4 letter --out stereo --board --square-mm --charuco --dictionary --legacy --left --right --json quick import --ros --opencv --size --unit --swap export --calibration" ;;
            cameras) words="-h --help --seconds --config --sim --json" ;;
            dashboard) words="-h --help --port --socket" ;;
            demo) words="-h --help --seed --time-scale --table plain patterned --parts printed --machined --fixed --runs" ;;
            export) words="-h --help --runs --csv --mcap --out --cell" ;;
            fleet) words="-h --help --runs --days --out" ;;
            model) words="-h --help show --json diff check" ;;
            recognise) words="-h --help --calibration --model --json --draw" ;;
            replay) words="-h --help --runs --with --workers --cluster --out --json" ;;
            review) words="-h --help --runs --out --against --cycle --week" ;;
            runs) words="-h --help --runs --last --json collect --into --free" ;;
            snap) words="-h --help --count --every --config --sim --json" ;;
            stream) words="-h --help --port --fps --plain --config --sim --json" ;;
            tail) words="-h --help --runs --once" ;;
            thesis) words="-h --help silhouettes --vigilance --show --json" ;;
            train) words="-h --help --calibration --views --mesh --unit --out --facets --parts" ;;
            completion) words="bash zsh" ;;
            *) words="--help" ;;
        esac
    fi
    case "$cur" in
        -*) ;;
        *) case " abort accept auto bundle calibrate cameras clear confirm disable doctor dry enable forget go gripper hand help here holding job jog look model note notices operator parts pause pick place positions refuse reload resume robot rollback scatter show signal status step stop switch teach train try untaught views where " in
            *" ${COMP_WORDS[1]} "*) [ "$COMP_CWORD" -gt 1 ] &&
                words="$words $(facetctl completion of "${COMP_WORDS[@]:1:$COMP_CWORD}" 2>/dev/null)" ;;
           esac ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
    case "${COMP_WORDS[1]}" in
        arm|calibrate|model|snap|thesis|script) [ "$COMP_CWORD" -gt 1 ] && COMPREPLY+=($(compgen -f -- "$cur")) ;;
    esac
}
complete -o filenames -F _facetctl facetctl
