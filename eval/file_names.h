/* file_names.h: what files of scenes and views are called: names that are unique in a set, hold no
 * '/', and so never overwrite one another.
 *
 * Ownership: [count] names as one list, freed once with lf_file_names_free.
 */
#ifndef LF_EVAL_FILE_NAMES_H
#define LF_EVAL_FILE_NAMES_H

#include "datasets/scene_set.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of the scenes of a set: the last part of the path; where several have the same, the part above
 * stands before it ("a-chair", "b-chair"); what is still equal gets "-2", "-3". */
char **lf_scene_file_names(const lf_scene_set *set);
/* Of the views of a scene: the whole name without the ending behind the last dot, with '-' for '/'
 * ("cam0/1.png": "cam0-1"); what is equal then gets "-2", "-3". */
char **lf_view_file_names(const lf_scene *scene);
void lf_file_names_free(long count, char **name);

#ifdef __cplusplus
}
#endif
#endif
