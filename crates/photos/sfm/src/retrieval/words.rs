//! Photos by the words that they have.

/// For each word the photos that have it.
#[derive(Clone, Debug)]
pub(super) struct Index {
    photos: usize,
    /// Weight of each word: the logarithm of one over the share of photos that have it.
    rarity: Vec<f32>,
    /// For each word the ranks of the photos that have it, ascending, and its weights there.
    places: Vec<Vec<(u32, f32)>>,
}

impl Index {
    /// The index of photos, given as words and how often each occurs, of a vocabulary of `words`.
    pub fn new<'a>(words: usize, photos: impl Iterator<Item = &'a [(u32, u32)]> + Clone) -> Self {
        let mut having = vec![0; words];
        let mut count = 0;
        for photo in photos.clone() {
            count += 1;
            photo.iter().for_each(|(word, _)| having[*word as usize] += 1);
        }
        let rarity = having.iter().map(|having| (count as f32 / (*having).max(1) as f32).ln()).collect();
        let mut index = Self { photos: count, rarity, places: vec![Vec::new(); words] };
        for (rank, photo) in photos.enumerate() {
            for (word, weight) in index.weights(photo) {
                index.places[word as usize].push((rank as u32, weight));
            }
        }
        index
    }

    /// The weights of a photo's words, the square root of how often each occurs times its rarity, of length 1 in all.
    fn weights(&self, counts: &[(u32, u32)]) -> Vec<(u32, f32)> {
        let weight = |(word, count): &(u32, u32)| (*word, (*count as f32).sqrt() * self.rarity[*word as usize]);
        let mut weights: Vec<(u32, f32)> = counts.iter().map(weight).filter(|(_, weight)| *weight > 0.0).collect();
        let length = weights.iter().map(|(_, weight)| weight * weight).sum::<f32>().sqrt();
        weights.iter_mut().for_each(|(_, weight)| *weight /= length);
        weights
    }

    /// The cosine between the weights of a photo and the weights of each photo of the index, by rank.
    pub fn similar(&self, counts: &[(u32, u32)]) -> Vec<f32> {
        let mut similar = vec![0.0; self.photos];
        for (word, weight) in self.weights(counts) {
            for (rank, other) in &self.places[word as usize] {
                similar[*rank as usize] += weight * other;
            }
        }
        similar
    }
}
